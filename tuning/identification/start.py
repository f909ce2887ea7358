"""The glider that a fit starts from: the vehicle file, and guesses from the record.

The search would not come back from a glider that floats or tumbles, so its mass and the
zero of its moving mass are taken from the record first.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Scalar
from jaxglider.signals import Command
from jaxglider.vehicle.mass_matrix import mass_matrix
from jaxglider.vehicle.parameters import BodyParameters, VehicleData
from tuning.identification.glider import (
    TEMPERATURE,
    IdentifiedGlider,
    RecordParameters,
    with_values,
)
from tuning.identification.predict import glide
from tuning.identification.record.uniform import Flight

COMPRESSIBILITY = 5e-10
"""ε [1/Pa] to start from; that which gliderflight takes for a Slocum."""


def starting_glider(
    vehicle: VehicleData, flight: Flight, volume: float | None
) -> IdentifiedGlider:
    """The vehicle as the fit starts from it, neutral between its dives and climbs.

    Args:
        vehicle: vehicle file.
        flight: the record.
        volume: V [m³]; by default the vehicle's mass over the mean density.

    Raises:
        ValueError: the file does not say how much water the vehicle displaces.
    """
    good = flight.good
    if vehicle.body is None:
        if volume is None:
            raise ValueError(
                f"{vehicle.name} has no table [body], so its volume is unknown: give "
                "the volume, in m³."
            )
        body = BodyParameters(*(1.0, *(0.0,) * 10))
    else:
        body = vehicle.body
    if volume is None:
        displaced = float(body.displaced_mass(vehicle.parameters))
        volume = displaced / float(np.mean(flight.density[good]))
    record = RecordParameters(compressibility=COMPRESSIBILITY)
    glider = IdentifiedGlider(vehicle.parameters, body, record, volume)
    afloat = flight.density * flight.ballast - _excess(glider, flight)
    down = good & (flight.depth_rate > 0.03)
    up = good & (flight.depth_rate < -0.03)
    neutral = 0.5 * (np.median(afloat[down]) + np.median(afloat[up]))
    glider = with_values(glider, {"mass": neutral})
    if vehicle.body is not None and flight.has("mass_position"):
        offset = balanced_offset(glider, flight)
        glider = with_values(glider, {"position_offset": offset})
    return glider


def _excess(glider: IdentifiedGlider, flight: Flight) -> np.ndarray:
    """Mass by which the glider is heavier than the record's water, ballast out [kg]."""
    measured = np.isfinite(flight.temperature)
    temperature = np.where(measured, flight.temperature, TEMPERATURE)
    return np.asarray(glider.excess(flight.pressure, flight.density, temperature))


def balanced_offset(glider: IdentifiedGlider, flight: Flight) -> float:
    """The recorded position of the moving mass [m] that is r_p1 = 0.

    On a steady glide the moment of weight and water is zero,
    −g (below sin θ + ahead cos θ) + (K_M0 + K_M α) V² = 0; this gives the first moment
    `ahead` that the glider must have had, and the moving mass has to make up for what
    hull and ballast lack of it.

    Args:
        glider: glider with its mass.
        flight: record with positions of the moving mass.
    """
    at = flight.steady & np.isfinite(flight.mass_position)
    pumped = flight.density * flight.ballast
    excess = _excess(glider, flight)
    pitch = np.asarray(glider.true_pitch(flight.pitch))
    moved = _needed(glider, pitch[at], excess[at] - pumped[at], pumped[at])
    return float(np.median(flight.mass_position[at] - np.asarray(moved)))


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, 0))
def _needed(
    glider: IdentifiedGlider, pitch: Scalar, heaviness: Scalar, pumped: Scalar
) -> Scalar:
    """r_p1 that balances the moments at one instant [m]."""
    u, w = glide(glider, pitch, heaviness)
    zero = 0.0 * pitch
    mass = mass_matrix(glider.parameters, glider.body, Command(-pumped, zero, zero))
    p = glider.parameters
    water = p.pitch_moment_offset + p.pitch_moment_slope * w / (u + 1e-6)
    lever = water * (u * u + w * w) / p.gravity - mass.below * jnp.sin(pitch)
    return (lever / jnp.cos(pitch) - mass.ahead) / p.moving_mass
