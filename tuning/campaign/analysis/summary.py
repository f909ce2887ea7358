"""Summary of a campaign: probabilities, measures, comparisons as plain numbers."""

import dataclasses
import warnings
from typing import Any

import numpy as np

from jaxglider.signals import CHANNELS
from tuning.campaign.analysis.requirements import ENDS
from tuning.campaign.run.campaign import CampaignSettings
from tuning.campaign.run.rows import FLIGHT_COLUMNS, Rows
from tuning.reporting.statistics import (
    discordant,
    paired_difference,
    probability,
    spread,
)
from tuning.reporting.tables import headline

MEASURES = (
    *(
        f"{channel}.{measure}"
        for channel in CHANNELS
        for measure in (
            "max_error",
            "max_error_settled",
            "rms_error",
            "rms_effort",
            "chattering",
            "travel",
            "time_outside_funnel",
            "time_saturated",
            "funnel_peak",
        )
    ),
    "max_roll",
    "max_pitch",
    "end_time",
)
"""Columns that are summarised."""
FLIGHT_MEASURES = tuple(name for name in FLIGHT_COLUMNS if name != "status")
"""Columns of flights of yos that are summarised besides."""


def measures_of(*, flight: bool) -> tuple[str, ...]:
    """Columns that are summarised, of flights of yos or of other runs."""
    return (*MEASURES, *FLIGHT_MEASURES) if flight else MEASURES


COMPARED = tuple(
    f"{channel}.{measure}"
    for channel in CHANNELS
    for measure in ("rms_error", "rms_effort", "chattering")
)
"""Columns that are compared member by member."""
FLIGHT_COMPARED = (
    "flight.energy_per_made_good",
    "flight.heading_error",
    "flight.travel.mass_angle",
    "flight.moves.mass_angle",
)
"""Columns of flights of yos that are compared besides."""


@dataclasses.dataclass(frozen=True)
class ControllerSummary:
    """Outcome of a campaign for one set of gains.

    Attributes:
        kind: name of the control law.
        origin: word or file that the gains came from.
        probabilities: probability of each kind of trouble, with its interval.
        failed_members: numbers of the members that became non-finite.
        worst_member: number of the most severe member.
        median_member: number of the member of median severity.
        measures: quantiles and means of each of `MEASURES`, with intervals.
        not_flown: number of members whose last waypoint is reached where they start.
        ends: number of members by the end of their mission, where yos are flown.
        rank_correlations: uncertain numbers that drive each output, strongest first.
        broken: probability that each part of the specification is broken, `any` first,
            with its interval.
        ledger: assumptions of the theorem, by name: how often each held.
        sensitivity: Sobol indices and gradients of each output; None where not asked
            for.
    """

    kind: str
    origin: str
    probabilities: dict[str, Any]
    failed_members: list[int]
    worst_member: int
    median_member: int
    measures: dict[str, Any]
    not_flown: int = 0
    ends: dict[str, int] = dataclasses.field(default_factory=dict)
    broken: dict[str, Any] = dataclasses.field(default_factory=dict)
    ledger: dict[str, Any] = dataclasses.field(default_factory=dict)
    rank_correlations: dict[str, Any] = dataclasses.field(default_factory=dict)
    sensitivity: dict[str, Any] | None = None


@dataclasses.dataclass(frozen=True)
class CampaignSummary:
    """Outcome of a campaign, as it stands in summary.json.

    Attributes:
        scenario: name of what was flown.
        plant: name of the plant.
        has_waypoints: whether there was a course of waypoints.
        precision: precision of the rollouts, 32 or 64 bits.
        design: placement of the members.
        seed: seed of the members.
        uncertainty: relative half width, or `file` where a file says it.
        members: number of members.
        members_asked_for: number that was asked for.
        confidence: level of all intervals.
        controllers: summary of each set of gains, by its label.
        paired: comparisons of the first set of gains with each other one.
        requirements: verdict on each requirement for each set of gains.
        provenance: versions, hardware, command and time.
        vehicle: name of the vehicle; empty where loops were given.
    """

    scenario: str
    plant: str
    has_waypoints: bool
    precision: int
    design: str
    seed: int
    uncertainty: float | str
    members: int
    members_asked_for: int
    confidence: float
    controllers: dict[str, ControllerSummary]
    paired: list[dict[str, Any]]
    requirements: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    provenance: dict[str, Any] = dataclasses.field(default_factory=dict)
    vehicle: str = ""

    @property
    def headline(self) -> str:
        """Title of what was flown: case, vehicle and plant."""
        return headline(self.scenario, self.vehicle, self.plant)

    @property
    def has_flights(self) -> bool:
        """Whether yos were flown."""
        return any(of.ends for of in self.controllers.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, as they stand in summary.json."""
        table = dataclasses.asdict(self)
        for controller in table["controllers"].values():
            if controller["sensitivity"] is None:
                del controller["sensitivity"]
        return table


def summarise(
    settings: CampaignSettings,
    table: Rows,
    kinds: tuple[str, ...],
    waypoints: int | None,
    level: float,
) -> CampaignSummary:
    """The summary of a campaign, without what drives it and what is required of it.

    Args:
        settings: settings of the campaign.
        table: rows of the campaign.
        kinds: kinds of the controllers.
        waypoints: number of waypoints of the course, or None where there is none.
        level: confidence of the intervals.
    """
    controllers = {
        label: ControllerSummary(
            kind=kind,
            origin=settings.gains[number].origin,
            probabilities=probabilities(table, number, waypoints, level),
            failed_members=numbers_of(table, table.failed(number)),
            worst_member=ranked(table, number)[-1],
            median_member=ranked(table, number)[(len(table) - 1) // 2],
            measures={
                name: spread(table.column(number, name), level)
                for name in measures_of(flight=table.has_flight)
            },
            not_flown=int(np.sum(table.raw(number, "end_time") == 0.0)),
            ends=table.ends(number),
        )
        for number, (label, kind) in enumerate(zip(table.labels, kinds, strict=True))
    }
    uncertainty = settings.uncertainty
    return CampaignSummary(
        scenario=settings.scenario,
        plant=settings.plant,
        has_waypoints=waypoints is not None,
        precision=settings.precision,
        design=settings.design,
        seed=settings.seed,
        uncertainty=uncertainty if isinstance(uncertainty, float) else "file",
        members=len(table),
        members_asked_for=settings.members,
        confidence=level,
        controllers=controllers,
        paired=comparisons(table),
        vehicle=settings.vehicle,
    )


def probabilities(
    table: Rows, number: int, waypoints: int | None, level: float
) -> dict[str, Any]:
    """Probability of each kind of trouble; a failed run counts as all of them.

    Args:
        table: rows of the campaign.
        number: number of the set of gains.
        waypoints: number of waypoints of the course, or None where there is none.
        level: level of confidence of the intervals.
    """
    events = {"p_violation": table.left_funnel(number)}
    for channel in CHANNELS:
        events[f"p_violation_{channel}"] = table.left_funnel(number, channel)
    events["p_capsize"] = table.capsized(number)
    events["p_unfinished"] = table.unfinished(number, waypoints)
    events["p_failure"] = table.failed(number)
    if table.has_flight:
        events |= {name: table.ended(number, end) for name, end in ENDS.items()}
    return {name: probability(event, level) for name, event in events.items()}


def comparisons(table: Rows) -> list[dict[str, Any]]:
    """The first set of gains against each other one, on the same members."""
    compared = (*COMPARED, *FLIGHT_COMPARED) if table.has_flight else COMPARED
    return [
        {
            "first": table.labels[0],
            "second": table.labels[number],
            "violation": discordant(table.left_funnel(0), table.left_funnel(number)),
            "measures": {
                name: paired_difference(
                    table.column(0, name), table.column(number, name)
                )
                for name in compared
            },
        }
        for number in range(1, len(table.labels))
    ]


def severity(table: Rows, number: int) -> np.ndarray:
    """The largest error over the edge of its funnel; infinite for failures.

    With good gains it is the error that every member starts with. So its first digits
    alone count, and what is below them is by the rms errors over their medians.
    """
    peaks = [table.column(number, f"{channel}.funnel_peak") for channel in CHANNELS]
    largest = np.maximum.reduce(peaks)
    errors = np.stack([table.column(number, f"{c}.rms_error") for c in CHANNELS])
    known = np.where(np.isfinite(errors) & np.isfinite(largest), errors, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        median = np.nanmedian(known, axis=1, keepdims=True)
    ratio = np.nan_to_num(np.mean(known / np.maximum(median, 1e-12), axis=0))
    return np.round(largest / TIED) * TIED + TIED * ratio / (1.0 + ratio)


TIED = 1e-3
"""Difference of the largest errors over their edges from which on one is worse."""


def ranked(table: Rows, number: int) -> list[int]:
    """Numbers of the members from the least to the most severe.

    A mission that did not come to its end is more severe than any that did.
    """
    short = table.unfinished(number, None)
    order = np.lexsort((severity(table, number), short))
    return [int(n) for n in table.rows["member"][order]]


def numbers_of(table: Rows, chosen: np.ndarray) -> list[int]:
    """Numbers of the members chosen."""
    return [int(n) for n in table.rows["member"][chosen]]
