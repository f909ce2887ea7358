"""The cases that `bench_laws.py` tunes every law for, and what a law's run costs there.

The paper's cases have the cost of `jaxglider tune`, each measure over a fixed scale
instead of over the start of each law.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxglider.control.textbook.mpc import MPC
from jaxglider.control.textbook.regulator import AbstractRegulator
from jaxglider.signals import CHANNELS, COMMAND_UNITS, Command
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import PAPER
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
        """The closed loop with a law as it begins.

        Regulators run no faster than the case ticks, and are told what its actuators
        can do.
        """
        (chosen,) = self.flight.resolve([PAPER], [law])
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


def _designed(loop: ClosedLoop) -> Any:
    law, scenario = loop.controller, loop.scenario
    if not isinstance(law, AbstractRegulator):
        return law
    law = dataclasses.replace(law, period=jnp.maximum(law.period, scenario.clock.dt))
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
