"""Knowledge after a fit: intervals, what was not identifiable, and warnings."""

import dataclasses

import numpy as np

from tuning.identification.fitting import Fit
from tuning.identification.information.least_squares import strongest_pairs
from tuning.identification.record.flight_record import FlightRecord
from tuning.identification.verdict import Verdict

LEARNED = 0.75
"""Share of the prior variance that a record must take away to have told a number."""
QUANTILE = 1.959964
"""Half width of a 95 % interval in standard deviations."""
STEERABLE = 0.5
"""Share of the turn rate's variance to be explained before heading may be tuned."""


@dataclasses.dataclass(frozen=True)
class Estimate:
    """One free number before and after the fit.

    Attributes:
        name: name of the number.
        unit: unit of the number.
        before: value to start from.
        prior: prior standard deviation.
        stated: whether the vehicle file states that deviation, or it was assumed.
        value: fitted value.
        deviation: standard deviation after the fit.
        low: lower end of the 95 % interval.
        high: upper end.
        learned: share of the prior variance that the record took away.
        profile: ends of the 95 % interval of the profile likelihood, NaN for one that
            was not found; None where it was not looked for.
    """

    name: str
    unit: str
    before: float
    prior: float
    stated: bool
    value: float
    deviation: float
    low: float
    high: float
    learned: float
    profile: tuple[float, float] | None = None

    @property
    def identified(self) -> bool:
        """Whether the record told the number."""
        return self.learned >= LEARNED


def estimates(fit: Fit) -> tuple[Estimate, ...]:
    """The free numbers with their intervals.

    Args:
        fit: the fit.
    """
    found = []
    for k, free in enumerate(fit.plan.free):
        x = float(fit.solution.x[k])
        spread = float(np.sqrt(fit.solution.covariance[k, k]))
        ends = [float(free.value(x + s * QUANTILE * spread)) for s in (-1.0, 1.0)]
        found.append(
            Estimate(
                name=free.name,
                unit=free.unit,
                before=free.start,
                prior=free.prior,
                stated=free.stated,
                value=float(free.value(x)),
                deviation=abs(free.slope(x)) * spread,
                low=min(ends),
                high=max(ends),
                learned=1.0 - spread * spread,
                profile=fit.profiles.get(free.name),
            )
        )
    return tuple(found)


def remarks(fit: Fit, verdict: Verdict, record: FlightRecord) -> tuple[str, ...]:
    """Warnings, in words: whatever a reader must know before using the numbers.

    Args:
        fit: the fit.
        verdict: verdict on the fit.
        record: record that it was made on.
    """
    found = [*_speed(fit, verdict), *_identified(fit), *_heading(fit, verdict, record)]
    if not fit.solution.converged:
        found.append(
            "The search ended before it had converged: do not use the numbers; free "
            "fewer of them."
        )
    found += [f"In the record, {text}" for text in record.warnings()]
    found += [f"In the record, {text}" for text in fit.flight.notes]
    return tuple(found)


def _speed(fit: Fit, verdict: Verdict) -> list[str]:
    """The trap that no residual shows: speed and the tilt of the pitch sensor."""
    if "speed" in fit.plan.channels:
        return []
    flight = fit.flight
    pitch = np.abs(fit.after.true_pitch(flight.pitch[flight.steady]))
    share = float(np.mean(np.sin(pitch) / np.sin(0.9 * pitch))) - 1.0
    text = (
        "SPEED IS UNTESTED: only the depth rate was fitted. A pitch sensor that shows "
        f"10 % too much would make the true speed {100 * share:.0f} % higher and fit "
        "as well; drag follows, by twice that."
    )
    if "speed" in verdict.scores:
        bias = 100.0 * verdict.scores["speed"]["held_out"].bias
        text += (
            " The recorded speed, which was not used, says that the predicted one is "
            f"{bias:+.1f} cm/s off on the held-out dives."
        )
    return [text]


def _identified(fit: Fit) -> list[str]:
    told = []
    for one in estimates(fit):
        if not one.identified:
            told.append(
                f"{one.name} is not identifiable from this record: its interval is "
                f"{np.sqrt(1.0 - one.learned):.0%} of the prior's. It stays near where "
                "it was, by the prior."
            )
    told += [text for one in estimates(fit) if (text := _bent(one))]
    pairs = strongest_pairs(
        fit.solution.covariance, [p.name for p in fit.plan.free], least=0.95
    )
    for first, second, value in pairs[:3]:
        told.append(
            f"{first} and {second} are told together only (correlation {value:+.2f}): "
            "use both or neither."
        )
    condition = fit.solution.condition()
    if condition > 1e4:
        told.append(
            f"The record's information has the condition number {condition:.1e}: some "
            "combination of the numbers rests on the priors alone."
        )
    return told


def _bent(one: Estimate) -> str:
    """A sentence where profile and Fisher information do not agree; else nothing."""
    if one.profile is None:
        return ""
    width = one.high - one.low
    ends = zip(one.profile, (one.low, one.high), strict=True)
    if all(abs(found - said) < 0.15 * width for found, said in ends):
        return ""
    low, high = (f"{x:.4g}" if np.isfinite(x) else "no end" for x in one.profile)
    return (
        f"{one.name}: by its profile likelihood the 95 % interval is {low} to {high}, "
        f"not {one.low:.4g} to {one.high:.4g}, which holds for a straight model: "
        "believe the profile."
    )


def _heading(fit: Fit, verdict: Verdict, record: FlightRecord) -> list[str]:
    if "turn_rate" in fit.plan.channels:
        explained = verdict.scores["turn_rate"]["held_out"].explained
        if explained >= STEERABLE:
            return []
        return [
            f"Of the turn rate {explained:.0%} is explained on the held-out dives: "
            "heading is not to be tuned on this vehicle."
        ]
    if record.has("fin") or record.has("wanted_heading"):
        steered = "a fin, which no plant here has" if record.has("fin") else "it"
        return [
            "HEADING IS NOT TO BE TUNED on this record: the glider steers by "
            f"{steered}; lateral coefficients were not fitted."
        ]
    return ["Nothing lateral was fitted: heading is not to be tuned on this vehicle."]
