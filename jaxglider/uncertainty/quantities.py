"""The usual uncertain quantities: coefficients, waves, and where the glider starts."""

import functools
import tomllib
from collections.abc import Iterator
from importlib import resources

import numpy as np

from jaxglider.environment.disturbances import (
    AbstractDisturbance,
    ScaledDisturbance,
    Sinusoid,
    Sum,
)
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.distributions import AbstractDistribution, Uniform
from jaxglider.uncertainty.members import Quantity, Uncertainty, look_up
from jaxglider.vehicle.parameters import UNCERTAIN

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


def relative(scenario: Scenario, name: str, factor: AbstractDistribution) -> Quantity:
    """A parameter of the glider with a distribution for its factor on the nominal.

    Args:
        scenario: scenario with the nominal value.
        name: name of the parameter.
        factor: distribution of the factor.

    Raises:
        ValueError: there is no such parameter, or the factor is not always positive.
    """
    path = f"plant.parameters.{name}"
    if factor.support()[0] <= 0.0:
        raise ValueError(
            f"{name}: the factor on the nominal value must stay positive; its "
            f"smallest is {factor.support()[0]:g}. Narrow its distribution."
        )
    nominal = float(look_up(scenario, path))
    return Quantity(
        name=name, path=path, unit=_units()[name], distribution=factor, scale=nominal
    )


def waves(
    scenario: Scenario,
    amplitude: AbstractDistribution | None,
    phase: AbstractDistribution | None,
) -> list[Quantity]:
    """Amplitudes and phases of every sinusoid of the sea, each axis by itself.

    Args:
        scenario: scenario whose disturbance holds the sinusoids.
        amplitude: distribution of the factor on the nominal amplitude, or None for
            nominal.
        phase: distribution of the angle added to the nominal phase [rad], or None for
            nominal.
    """
    sinusoids = list(_sinusoids(scenario.disturbance, "disturbance"))
    quantities = []
    for number, (path, sinusoid) in enumerate(sinusoids, 1):
        wave = "wave" if len(sinusoids) == 1 else f"wave{number}"
        for axis in AXES:
            nominal = float(getattr(sinusoid.amplitude, axis))
            if nominal == 0.0:
                continue
            force = "N" if axis in AXES[:3] else "N m"
            if amplitude is not None:
                place = f"{path}.amplitude.{axis}"
                quantities.append(
                    Quantity(
                        name=f"{wave}_amplitude_{axis}",
                        path=place,
                        unit=force,
                        distribution=amplitude,
                        scale=nominal,
                    )
                )
            if phase is not None:
                place, old = f"{path}.phase.{axis}", getattr(sinusoid.phase, axis)
                name = f"{wave}_phase_{axis}"
                quantities.append(
                    Quantity(
                        name=name,
                        path=place,
                        unit="rad",
                        distribution=phase,
                        offset=float(old),
                    )
                )
    return quantities


def start(
    scenario: Scenario, name: str, unit: str, offset: AbstractDistribution
) -> Quantity:
    """A quantity added to one number of the initial state, positions on the map.

    Args:
        scenario: the nominal one.
        name: name of the number in the state.
        unit: unit of the number.
        offset: distribution of what is added.
    """
    origin = float(getattr(scenario.origin, name, 0.0))
    nominal = origin + float(getattr(scenario.initial_state, name))
    path = f"initial_state.{name}"
    return Quantity(
        f"initial_{name}", path, unit, offset, offset=nominal, origin=origin
    )


def _sinusoids(
    disturbance: AbstractDisturbance, path: str
) -> Iterator[tuple[str, Sinusoid]]:
    if isinstance(disturbance, Sinusoid):
        yield path, disturbance
    elif isinstance(disturbance, ScaledDisturbance):
        yield from _sinusoids(disturbance.disturbance, f"{path}.disturbance")
    elif isinstance(disturbance, Sum):
        for number, term in enumerate(disturbance.terms):
            yield from _sinusoids(term, f"{path}.terms.{number}")


@functools.cache
def _units() -> dict[str, str]:
    """Units of the parameters, which stand beside the numbers in the data."""
    file = resources.files("jaxglider.vehicle") / "data" / "seawing.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return {name: entry["unit"] for name, entry in data["parameters"].items()}


def uniform_uncertainty(
    scenario: Scenario,
    parameters: float,
    amplitude: float = 0.0,
    position: float = 0.0,
) -> Uncertainty:
    """The paper's kind of uncertainty: one half width for all that it covers.

    Args:
        scenario: the nominal one.
        parameters: half width of masses, inertias and hydrodynamic coefficients,
            uniform, relative, in [0, 1).
        amplitude: half width of the waves' amplitudes, relative; their phases are then
            uniform on the circle. Zero leaves the waves alone.
        position: half width of the starting position north and east [m], uniform.

    Raises:
        ValueError: a number is outside its range.
    """
    for name, value in (("parameters", parameters), ("amplitude", amplitude)):
        if not 0.0 <= value < 1.0:
            raise ValueError(f"{name} must be in [0, 1); received {value}.")
    if not 0.0 <= position < float("inf"):
        raise ValueError(f"position must be zero or positive; received {position}.")
    quantities: list[Quantity] = []
    if parameters > 0.0:
        scatter = Uniform(1.0 - parameters, 1.0 + parameters)
        quantities += [relative(scenario, name, scatter) for name in UNCERTAIN]
    if amplitude > 0.0:
        factor = Uniform(1.0 - amplitude, 1.0 + amplitude)
        quantities += waves(scenario, factor, Uniform(-np.pi, np.pi))
    if position > 0.0:
        reach = Uniform(-position, position)
        for name in ("north", "east"):
            quantities.append(start(scenario, name, "m", reach))
    return Uncertainty(scenario, tuple(quantities))
