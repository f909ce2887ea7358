"""Numbers of a scenario against what gliders and seas have: warnings with reasons."""

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxglider.environment.disturbances import AbstractDisturbance
from jaxglider.signals import COMMAND_UNITS
from jaxglider.simulation.checks.causes import (
    ADRIFT,
    FAST,
    STALL,
    TORRENT,
    start_through_water,
)
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario
from jaxglider.vehicle.published import load_vehicle, vehicle_names

FACTOR = 10.0
"""Factor by which a parameter may be beyond those of the package's gliders."""
LARGEST_LIMITS = {"mass_position": (1.0, ""), "mass_angle": (math.pi, " Degrees?")}
"""Largest limits of the moving mass that make sense, and what may have been meant."""
RATES = {
    "buoyancy_mass": (1e-4, 1.0),
    "mass_position": (1e-5, 0.1),
    "mass_angle": (1e-3, 2.0),
}
"""Slowest and fastest actuators there are [kg/s, m/s, rad/s]."""
BALLAST_SHARE = 0.05
"""Largest share of the glider's mass that its pump moves: gliders have below 1 %."""
STEEPEST_GRADIENT, MOST_SQUEEZED = 1e-3, 1e-4
"""Largest relative growth of a sea's density, and loss of a hull's volume [1/m]."""


def range_warnings(loop: ClosedLoop) -> list[str]:
    """Warnings on numbers that no glider and no sea has.

    Args:
        loop: closed loop with concrete numbers.
    """
    scenario = loop.scenario
    return [
        *_start(loop),
        *_actuators(scenario),
        *_water(scenario),
        *_disturbance(scenario),
        *_parameters(scenario.plant.parameters),
    ]


def _start(loop: ClosedLoop) -> Iterator[str]:
    """The start: at rest in a current, too fast, upside down, or spinning."""
    ahead, aside, down = start_through_water(loop)
    speed = math.hypot(ahead, aside, down)
    start = loop.scenario.initial_state
    over_ground = math.hypot(*(float(x) for x in (start.surge, start.sway)))
    water = loop.scenario.water
    flows = water is not None and water.current is not None
    if speed > FAST:
        yield (
            f"the glider starts at {speed:.3g} m/s through the water; gliders make 0.2 "
            "to 0.5 m/s: see initial_state and water.current, in m/s."
        )
    elif flows and speed > ADRIFT and over_ground < ADRIFT:
        angle = math.degrees(math.atan2(math.hypot(aside, down), ahead))
        yield (
            "the glider starts at rest over ground in a current, so that the water "
            f"meets it at {speed:.3g} m/s, {angle:.0f} deg off its nose: surge_m_s, "
            "sway_m_s and heave_m_s are over ground. Give "
            "surge_through_water_m_s = 0.0 to start drifting with the water."
        )
    elif speed > ADRIFT and math.atan2(math.hypot(aside, down), ahead) > STALL:
        yield (
            "the water meets the glider at the start more than 25 deg off its nose, "
            "where no forces are known: see initial_state."
        )
    if abs(float(start.roll)) > math.pi / 2:
        yield "the glider starts upside down: see initial_state.roll_deg."
    spin = max(abs(float(x)) for x in (start.roll_rate, start.pitch_rate))
    if max(spin, abs(float(start.yaw_rate))) > 1.0:
        yield "the glider starts spinning, at more than 57 deg/s: see initial_state."


def _actuators(scenario: Scenario) -> Iterator[str]:
    """Limits and rates of the actuators."""
    mass = float(scenario.plant.parameters.surge_mass)
    for name, unit in COMMAND_UNITS.items():
        actuator = getattr(scenario.actuators, name)
        limit, where = float(actuator.limit), f"actuators.{name}"
        most, meant = LARGEST_LIMITS.get(name, (BALLAST_SHARE * mass, ""))
        if limit > most:
            yield (
                f"{where}.limit_{unit} is {limit:.4g}, and no glider goes beyond "
                f"{most:.3g} {unit}.{meant}"
            )
        slow, fast = RATES[name]
        rate = getattr(actuator, "rate_limit", None)
        rate = None if rate is None else float(rate)
        if rate is not None and not slow <= rate <= fast:
            word = "slower" if rate < slow else "faster"
            yield (
                f"{where}.rate_limit_{unit}_s is {rate:.4g}, {word} than any glider's: "
                f"they have {slow:g} to {fast:g} {unit}/s."
            )
        lag = getattr(actuator, "time_constant", None)
        if lag is not None and float(lag) > 300.0:
            yield f"{where}.time_constant_s is {float(lag):.4g}: a servo takes seconds."


def _water(scenario: Scenario) -> Iterator[str]:
    """Currents and density."""
    water = scenario.water
    if water is None:
        return
    if water.current is not None:
        plain = dataclasses.replace(water.current, table=None)
        c = {n: abs(float(x)) for n, x in vars(plain).items() if x is not None}
        speed = math.hypot(c["north"] + c["tide_north"], c["east"] + c["tide_east"])
        if (model := water.current.table) is not None:
            speed += float(np.max(np.hypot(model.north, model.east)))
        if speed > TORRENT:
            yield (
                f"water.current reaches {speed:.3g} m/s, more than any sea has: it is "
                "in m/s, and 1 cm/s is 0.01."
            )
        if max(c["shear_north"], c["shear_east"]) > 0.1:
            yield (
                "water.current changes by more than 0.1 m/s with every metre of depth: "
                "shear_north_1_s and shear_east_1_s are per metre."
            )
    layers = water.stratification
    if layers is None:
        return
    if abs(float(layers.density_gradient)) > STEEPEST_GRADIENT:
        yield (
            f"water.stratification.density_gradient_1_m is "
            f"{float(layers.density_gradient):.3g}: a sea has below 1e-3 in its "
            "sharpest layer. It is relative, not in kg/m^3 per metre."
        )
    if not 0.0 <= float(layers.hull_compressibility) <= MOST_SQUEEZED:
        yield (
            "water.stratification.hull_compressibility_1_m is "
            f"{float(layers.hull_compressibility):.3g}: hulls have about 4e-6."
        )


def _disturbance(scenario: Scenario) -> Iterator[str]:
    """Forces beside the weight of the ballast, which is all a glider has."""
    ballast = float(scenario.actuators.buoyancy_mass.limit)
    weight = ballast * float(scenario.plant.parameters.gravity)
    force = max(_forces(scenario.disturbance), default=0.0)
    if force > weight:
        yield (
            f"a disturbance of {force:.3g} N is more than the ballast weighs "
            f"({weight:.3g} N): the glider cannot go against it. See [[disturbance]], "
            "in N."
        )


def _forces(disturbance: AbstractDisturbance) -> Iterator[float]:
    """Sizes of the forces of a disturbance along the three axes [N]."""
    for part in getattr(disturbance, "terms", (disturbance,)):
        for name in ("amplitude", "standard_deviation", "force"):
            axes: Any = getattr(part, name, None)
            if axes is not None and hasattr(axes, "surge"):
                for value in (axes.surge, axes.sway, axes.heave):
                    yield float(np.max(np.abs(np.asarray(value))))


def _parameters(parameters: Any) -> Iterator[str]:
    """Parameters far from those of all gliders of the package."""
    for name, (low, high) in parameter_ranges().items():
        value = float(getattr(parameters, name))
        if not low <= value <= high:
            yield (
                f"vehicle.parameters.{name} is {value:.4g}; the gliders of the package "
                f"have {_span(name)}: check its sign and its unit."
            )


@functools.cache
def _published() -> dict[str, list[float]]:
    """Values of each parameter, of all gliders of the package."""
    gliders = [load_vehicle(name).parameters for name in vehicle_names()]
    return {
        name: [float(getattr(one, name)) for one in gliders]
        for name in vars(gliders[0])
    }


@functools.cache
def parameter_ranges() -> dict[str, tuple[float, float]]:
    """Ends of the range of each parameter, in SI units.

    Of one sign: a tenth of the smallest of the package's gliders to ten times the
    largest. Where one of them has zero or the signs differ: ten times the largest on
    either side.
    """
    found = {}
    for name, values in _published().items():
        low, high = min(values), max(values)
        if low > 0.0:
            found[name] = low / FACTOR, high * FACTOR
        elif high < 0.0:
            found[name] = low * FACTOR, high / FACTOR
        else:
            most = FACTOR * max(abs(low), abs(high), 0.1)
            found[name] = -most, most
    return found


def _span(name: str) -> str:
    values = _published()[name]
    return f"{min(values):.4g} to {max(values):.4g}"
