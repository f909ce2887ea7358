"""Free numbers of a fit: names, prior standard deviations, and coordinates.

Each free number p has a coordinate x with prior N(0, 1). Numbers whose sign the physics
fixes stay on their side of zero, p = p₀ exp(s x); all others are p = p₀ + s x. So the
prior is one row of the least squares, and no step leaves what a vehicle may be.
"""

import dataclasses
import fnmatch
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.published import key_units
from tuning.identification.glider import (
    PLACES,
    IdentifiedGlider,
    value_of,
    with_values,
)

ABSOLUTE = {
    "mass": (1.0, "kg"),
    "compressibility": (2e-10, "1/Pa"),
    "thermal_expansion": (5e-5, "1/K"),
    "pitch_scale": (0.1, "1"),
    "pitch_offset": (0.03, "rad"),
    "actuator_lag": (2.0, "s"),
    "position_offset": (0.03, "m"),
    "roll_offset": (0.05, "rad"),
    "angle_offset": (0.2, "rad"),
    "lift_offset": (2.0, "kg/m"),
    "pitch_moment_offset": (0.5, "kg"),
    "buoyancy_position": (0.5, "m"),
    "hull_ahead": (0.05, "m"),
    "hull_below": (0.005, "m"),
    "moving_ahead": (0.05, "m"),
    "sway_yaw_coupling": (5.0, "kg m"),
    "heave_pitch_coupling": (5.0, "kg m"),
}
"""Prior standard deviation, and unit, of what may have either sign."""
RELATIVE = 0.5
"""Prior standard deviation, relative, of a number whose file does not state one."""
FIXED = ("gravity", "moving_mass", "moving_ahead")
"""Numbers that no fit frees: known, or the same as others that are freed."""


def value_at(start: Any, prior: Any, x: Any, *, signed: bool) -> jax.Array:
    """p from its coordinate x; start and prior may be traced.

    Args:
        start: p₀.
        prior: s, standard deviation of the prior in the unit of p.
        x: coordinate.
        signed: whether the sign of the start is kept.
    """
    if signed:
        return start * jnp.exp(prior / jnp.abs(start) * x)
    return jnp.asarray(start + prior * x)


@dataclasses.dataclass(frozen=True)
class FreeParameter:
    """A number that a fit may change.

    Attributes:
        name: name of the number.
        unit: unit of the number.
        start: p₀, value to start from, and centre of the prior.
        prior: prior standard deviation, in the unit.
        signed: whether the sign of the start is kept.
        stated: whether the vehicle file states the deviation, or it was assumed.
    """

    name: str
    unit: str
    start: float
    prior: float
    signed: bool
    stated: bool

    def value(self, x: jax.Array | float) -> jax.Array:
        """p from its coordinate."""
        return value_at(self.start, self.prior, x, signed=self.signed)

    def slope(self, x: float) -> float:
        """Derivative dp/dx at a coordinate."""
        if self.signed:
            return float(
                np.sign(self.start)
                * self.prior
                * np.exp(self.prior / abs(self.start) * x)
            )
        return self.prior


PITCHING = (
    "position_offset",
    "buoyancy_position",
    "hull_below",
    "pitch_moment_slope",
    "pitch_damping",
    "pitch_inertia",
    "actuator_lag",
)
"""Numbers that decide how the glider pitches."""
TURNED = (
    "mass_offset",
    "angle_offset",
    "roll_moment_slope",
    "side_force_slope",
    "yaw_moment_slope",
    "yaw_damping",
)
"""Numbers that decide how the glider rolls and turns under its moving mass."""


def glide_names(speed: bool, depth: float) -> list[str]:
    """Names of the numbers that steady glides may tell.

    Args:
        speed: flag, speed through the water is fitted.
        depth: depth [m] of the dives; compressibility needs hundreds of metres.
    """
    names = ["drag", "mass"]
    if depth > 300.0:
        names.append("compressibility")
    if speed:
        names += ["lift_slope", "pitch_scale", "pitch_offset"]
    return names


def free_parameters(
    names: Sequence[str],
    glider: IdentifiedGlider,
    vehicle: VehicleData,
) -> tuple[FreeParameter, ...]:
    """The free numbers of a glider with their priors.

    Args:
        names: names, or patterns with `*`.
        glider: glider whose values are the centres of the priors.
        vehicle: vehicle whose file states deviations.

    Raises:
        ValueError: a name is no number of a glider, or one that no fit can free.
    """
    known = [name for name in PLACES if name not in FIXED]
    chosen: list[str] = []
    for pattern in names:
        found = fnmatch.filter(known, pattern)
        if not found:
            why = (
                "it is the same as others for a flight"
                if pattern in FIXED
                else "no such number"
            )
            raise ValueError(
                f"free must name numbers of the glider ({why}); received {pattern!r}. "
                f"Choose from {', '.join(known)}."
            )
        chosen += [name for name in found if name not in chosen]
    return tuple(_parameter(name, glider, vehicle) for name in chosen)


def _key(name: str) -> str:
    return f"{PLACES[name]}.{name}"


def _parameter(
    name: str, glider: IdentifiedGlider, vehicle: VehicleData
) -> FreeParameter:
    start = float(value_of(glider, name))
    stated = vehicle.deviations.get(_key(name))
    signed = name not in ABSOLUTE and start != 0.0
    assumed = ABSOLUTE[name][0] if name in ABSOLUTE else RELATIVE * abs(start)
    if assumed == 0.0:
        raise ValueError(
            f"free: {name} is 0 in the vehicle, so a relative doubt says nothing; give "
            "it a standard_deviation in the vehicle's file, or leave it out."
        )
    unit = ABSOLUTE[name][1] if name in ABSOLUTE else key_units()[_key(name)]
    return FreeParameter(
        name, unit, start, float(stated or assumed), signed, stated is not None
    )


def placed(
    glider: IdentifiedGlider, free: Sequence[FreeParameter], x: jax.Array
) -> IdentifiedGlider:
    """The glider with its free numbers at some coordinates.

    Args:
        glider: glider that has all other numbers.
        free: free numbers.
        x: coordinates, one for each.
    """
    return with_values(glider, {p.name: p.value(x[k]) for k, p in enumerate(free)})
