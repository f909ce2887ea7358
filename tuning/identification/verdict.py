"""The verdict on a fit: errors on dives that it was fitted to, and on others.

The whole flight is simulated in one go, as in flight: nothing but the very first sample
is given, and at the surface the glider starts anew.
"""

import dataclasses

import numpy as np

from tuning.identification.fitting import Fit
from tuning.identification.glider import IdentifiedGlider
from tuning.identification.record.uniform import Flight
from tuning.identification.samples import measured_channel, predicted
from tuning.identification.windows import cut

CHANNEL_UNITS = {
    "depth_rate": "m/s",
    "speed": "m/s",
    "pitch": "rad",
    "roll": "rad",
    "turn_rate": "rad/s",
}
"""Unit of each channel that a fit predicts."""


@dataclasses.dataclass(frozen=True)
class Score:
    """Errors of one channel.

    Attributes:
        rms: root mean square of measured less predicted.
        bias: mean of predicted less measured.
        explained: share of the variance that is explained, 1 − var(error)/var.
        count: number of samples.
    """

    rms: float
    bias: float
    explained: float
    count: int


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Measured and predicted, before the fit and after it.

    Attributes:
        measured: measured channels over the flight, NaN where none.
        before: channels that the vehicle file predicts.
        after: channels that the fitted glider predicts.
        scores: scores by channel and by stretch: `held_out` and `train` after the fit,
            `held_out_steady` in steady glides alone, `before` on the held-out dives
            before it.
    """

    measured: dict[str, np.ndarray]
    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]
    scores: dict[str, dict[str, Score]]


def simulate(
    kind: str, glider: IdentifiedGlider, flight: Flight
) -> dict[str, np.ndarray]:
    """Predicted channels over a whole flight.

    Args:
        kind: kind of the fit.
        glider: the glider.
        flight: record that gives the inputs.
    """
    every = np.ones(len(flight.time), dtype=bool)
    stretches = cut(flight, kind, every, whole=True)
    found = predicted(kind, glider, stretches.inputs)
    return {name: np.asarray(values)[0] for name, values in found.items()}


def judge(fit: Fit) -> Verdict:
    """Score a fit on the dives that were held out, and on the others.

    Args:
        fit: the fit.
    """
    flight, kind = fit.flight, fit.plan.kind
    after = simulate(kind, fit.after, flight)
    before = simulate(kind, fit.before, flight)
    held = np.isin(flight.dive, fit.plan.held_out) & flight.good
    train = flight.good & ~held
    measured, scores = {}, {}
    for name in after:
        judged = name in fit.plan.channels or name == "speed"
        if not judged or (name != "turn_rate" and not flight.has(name)):
            continue
        measured[name] = measured_channel(flight, name)
        scores[name] = {
            "before": score(measured[name], before[name], held),
            "train": score(measured[name], after[name], train),
            "held_out": score(measured[name], after[name], held),
            "held_out_steady": score(measured[name], after[name], held & flight.steady),
        }
    return Verdict(measured, before, after, scores)


def score(measured: np.ndarray, found: np.ndarray, flags: np.ndarray) -> Score:
    """Errors of one channel where flags are set.

    Args:
        measured: measured values; NaN where none.
        found: predicted values.
        flags: flags of the samples that count.
    """
    chosen = flags & np.isfinite(measured) & np.isfinite(found)
    if not chosen.any():
        return Score(float("nan"), float("nan"), float("nan"), 0)
    error = found[chosen] - measured[chosen]
    spread = float(np.var(measured[chosen]))
    return Score(
        rms=float(np.sqrt(np.mean(error**2))),
        bias=float(np.mean(error)),
        explained=1.0 - float(np.var(error)) / spread if spread > 0 else float("nan"),
        count=int(chosen.sum()),
    )
