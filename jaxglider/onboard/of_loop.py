"""The autopilot of a closed loop, as it stands on board."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import concrete
from jaxglider.guidance.routes import route_of
from jaxglider.navigation.navigator import Navigator
from jaxglider.navigation.perfect import Perfect
from jaxglider.onboard.autopilot import Autopilot
from jaxglider.onboard.guard import Guard
from jaxglider.onboard.sensed import SensedAutopilot
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario

Pilot = Autopilot | SensedAutopilot
"""An autopilot, told its state or what its sensors show."""
SAMPLES = 6.0
"""Number of its periods that a sensor may be silent."""


def autopilot(
    loop: ClosedLoop, guard: Guard | None = None, *, told_state: bool = False
) -> Pilot:
    """The autopilot of a closed loop, as it stands on board.

    Args:
        loop: the closed loop; vehicle, sea and sensors are left behind.
        guard: limits of believable inputs; the default ones if None.
        told_state: flag, it is told its state even where the loop has instruments.

    Raises:
        ValueError: where the loop starts or is to go is not believed by the guard, or
            its estimator is one that no glider has.
    """
    scenario, guard = loop.scenario, Guard() if guard is None else guard
    guard = guard.for_ticks(scenario.clock.dt)
    _refuse_disbelieved(loop, guard)
    pilot = Autopilot(
        controller=loop.controller.on_board(),
        observer=loop.observer,
        reference=scenario.reference,
        actuators=scenario.actuators,
        dt=scenario.clock.dt,
        guard=guard,
        origin=scenario.origin,
    )
    navigator = None if told_state else loop.navigator
    return pilot if navigator is None else _sensed(pilot, navigator, scenario)


def _sensed(
    pilot: Autopilot, navigator: Navigator, scenario: Scenario
) -> SensedAutopilot:
    """The autopilot of a glider with instruments."""
    if isinstance(navigator.estimator, Perfect):
        raise ValueError(
            "the estimator 'perfect' knows the true state, and no glider does; choose "
            "another, or have the autopilot told its state (--inputs state)."
        )
    instruments, start = navigator.instruments, scenario.initial_state
    periods = [sensor.period for sensor in instruments.sensed.fields()]
    slowest = functools.reduce(jnp.maximum, [*periods, pilot.dt])
    bottom = scenario.seabed is not None
    return SensedAutopilot(
        pilot=pilot,
        estimator=navigator.estimator,
        reckoning=navigator.reckoning,
        altimeter=instruments.altimeter if bottom else None,
        place=(start.north, start.east),
        patience=jnp.maximum(pilot.guard.patience, SAMPLES * slowest),
        receiver=instruments.positioning is not None,
    )


def _refuse_disbelieved(loop: ClosedLoop, guard: Guard) -> None:
    """Refuse a loop whose own measurements the autopilot would take for broken."""
    scenario, ranges = loop.scenario, guard.ranges()
    places = {
        f"initial_state.{name}": (value, getattr(ranges, name))
        for name, value in vars(scenario.initial_state).items()
    }
    path = route_of(scenario.reference)
    if path is not None:
        for name in ("north", "east"):
            value = getattr(path, name)
            places[f"waypoints.{name}"] = value, guard.position
    for name, (value, limit) in places.items():
        seen = concrete(value)
        if seen is not None and not np.all(np.abs(seen) <= float(limit)):
            raise ValueError(
                f"{name} must be within {float(limit):g}, as far as the autopilot "
                "believes a measurement (positions from the start, if that is far from "
                f"zero); received {float(np.max(np.abs(seen))):g}. It would not steer."
            )
