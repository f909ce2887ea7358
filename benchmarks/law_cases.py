"""The cases that `bench_laws.py` tunes every law for, and what a law's run costs there.

The paper's cases have the cost of `jaxglider tune`, each measure over a fixed scale
instead of over the start of each law. A mission of yos costs by what its operators look
at: heading, pitch, energy of the way through the water, moves of the actuators.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxglider.control.textbook.mpc import MPC
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import load_mission
from jaxglider.guidance.phases import COMPLETED
from jaxglider.signals import CHANNELS, COMMAND_UNITS, Command
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import MISSION, PAPER
from tuning.problem.objective_file import DEFAULT_WEIGHTS

SCALES = {
    # measure: depth, pitch, heading
    "rms_error": (0.15, 0.06, 0.3),
    "chattering": (2e-4, 4e-5, 3e-3),
    "travel": (1.0, 0.15, 25.0),
}
"""What counts as one: about what the paper's laws come to in `switching`."""


def paper_cost(metrics: Any, start: Any) -> Any:
    """The weights of `jaxglider tune`, each measure over its fixed scale."""
    weights: Any = DEFAULT_WEIGHTS
    roll = jnp.maximum(metrics.max_roll - 0.785, 0.0)
    total = weights.roll * roll * roll
    for number, channel in enumerate(CHANNELS):
        of = getattr(metrics.channels, channel)
        total += weights.tracking[number] * of.rms_error / SCALES["rms_error"][number]
        total += weights.chattering * of.chattering / SCALES["chattering"][number]
        total += weights.travel * of.travel / SCALES["travel"][number]
        total += weights.crowding * of.funnel_crowding
        total += weights.saturation * of.saturation_excess
    return total


@dataclasses.dataclass(frozen=True)
class LawCase:
    """A case to tune laws for.

    Attributes:
        flight: task and design model.
        cost: cost of a run.
        measures: measures of a run for the table, by their heads.
        lost: whether a run is lost, on arrays over members.
        left: head of another event, and whether it happened; or None.
    """

    flight: FlightCase
    cost: Callable[[Any, Any], Any]
    measures: dict[str, Callable[[Any], Any]]
    lost: Callable[[Any], Any]
    left: tuple[str, Callable[[Any], Any]] | None = None

    def loop(self, law: str) -> ClosedLoop:
        """The closed loop with a law as it begins, a mission's own with its gains.

        A predictive one is told what its actuators can do.
        """
        own = self.flight.own
        flown = own is not None and own.label.split()[0] == law
        (chosen,) = self.flight.resolve([MISSION if flown else PAPER], [law])
        loop = self.flight.loop(chosen)[1]
        return dataclasses.replace(loop, controller=_designed(loop))


def paper_case(
    scenario: str, plant: str, dt: float | None, duration: float | None
) -> LawCase:
    """One of the paper's cases, its actuators with the speeds of the vehicle's file."""

    def channel(name: str, measure: str) -> Callable[[Any], Any]:
        return lambda metrics: getattr(getattr(metrics.channels, name), measure)

    heads = {"depth [m]": ("depth", "rms_error")}
    heads |= {f"{name} [rad]": (name, "rms_error") for name in ("pitch", "heading")}
    ways = {"pump [kg]": "depth", "mass [m]": "pitch", "angle [rad]": "heading"}
    heads |= {head: (name, "travel") for head, name in ways.items()}
    peaks = [channel(name, "funnel_peak") for name in CHANNELS]
    return LawCase(
        FlightCase.of_paper(scenario, plant, dt, duration, "vehicle"),
        paper_cost,
        {head: channel(*of) for head, of in heads.items()},
        lambda metrics: ~np.asarray(metrics.finite) | np.asarray(metrics.capsized),
        ("left a funnel", lambda m: np.max([of(m) for of in peaks], axis=0) > 1.0),
    )


FLIGHT_SCALES = {
    "heading_error": (4.0, 0.1),
    "pitch_error": (2.5, 0.05),
    "energy_per_through_water": (2.0, 10.0),
}
"""Weight of each measure of a flight, and what counts as one [rad, rad, J/m]."""
MOVES_WEIGHT, MOVES_SCALE = 0.5, 400.0
"""Weight of the moves of both actuators that control, and what counts as one [1/h]."""
ENDED_OTHERWISE = 10.0
"""Cost of a mission that was not flown to its end: more than all of a fair flight."""
LOST = 400.0
"""Cost of a run without measures: more than rolling over and ending early."""


def moves_per_hour(metrics: Any) -> Any:
    """Moves of mass and of what steers, in an hour."""
    moves = metrics.flight.moves
    return 3600.0 * (moves.mass_position + moves.mass_angle) / metrics.end_time


def mission_cost(metrics: Any, start: Any) -> Any:
    """Heading, pitch, energy and moves over fixed scales; rolling and early ends."""
    # Half a turn or ten: lost is lost.
    roll = jnp.clip(metrics.max_roll - 0.785, 0.0, jnp.pi)
    total = 30.0 * roll * roll
    for name, (weight, scale) in FLIGHT_SCALES.items():
        total += weight * getattr(metrics.flight, name) / scale
    total += MOVES_WEIGHT * moves_per_hour(metrics) / MOVES_SCALE
    total += jnp.where(metrics.status == COMPLETED, 0.0, ENDED_OTHERWISE)
    return jnp.where(jnp.isfinite(total), total, LOST)


def mission_case(name: str, duration: float | None) -> LawCase:
    """A mission of yos that comes along, judged by its flight.

    Args:
        name: name of the mission.
        duration: another horizon [s].
    """

    def flown(measure: str) -> Callable[[Any], Any]:
        return lambda metrics: getattr(metrics.flight, measure)

    return LawCase(
        FlightCase.of_mission(load_mission(mission_path(name)), duration),
        mission_cost,
        {
            "heading [rad]": flown("heading_error"),
            "pitch [rad]": flown("pitch_error"),
            "depth rate [m/s]": flown("depth_rate"),
            "through water [kJ/km]": flown("energy_per_through_water"),
            "made good [kJ/km]": flown("energy_per_made_good"),
            "pump [kJ]": lambda metrics: metrics.flight.energy.pump / 1e3,
            "moves [1/h]": moves_per_hour,
        },
        lambda metrics: ~np.asarray(metrics.finite) | np.asarray(metrics.capsized),
        ("ended otherwise", lambda m: np.asarray(m.status) != COMPLETED),
    )


def _designed(loop: ClosedLoop) -> Any:
    law, scenario = loop.controller, loop.scenario
    if not isinstance(law, MPC):
        return law
    limits, rates = {}, {}
    for name in COMMAND_UNITS:
        actuator, begun = getattr(scenario.actuators, name), law.rate_limit
        limits[name] = actuator.limit
        rate = actuator.rate_limit
        rates[name] = getattr(begun, name) if rate is None else rate
    return dataclasses.replace(
        law, limit=Command(**limits), rate_limit=Command(**rates)
    )
