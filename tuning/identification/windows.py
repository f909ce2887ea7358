"""Stretches of a flight that are simulated side by side, each with a run-in.

Multiple shooting with starts from the record: a long run need not stay on course for
hours, and what a start gets wrong has died out before anything is compared.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.identification.glider import TEMPERATURE
from tuning.identification.record.slopes import slope
from tuning.identification.record.uniform import Flight

Grid = Float[Array, "windows steps"]


class Windows(eqx.Module):
    """Inputs of a simulation, one row a stretch.

    Attributes:
        pressure: pressure [Pa].
        density: density of the water [kg/m³].
        temperature: temperature [°C].
        ballast: volume of the ballast [m³].
        pitch: pitch as recorded [rad].
        pitch_rate: rate of the recorded pitch [rad/s].
        roll: roll as recorded [rad].
        mass_position: recorded position of the moving mass [m].
        mass_angle: roll angle of the moving mass [rad].
        afloat: 1 where the glider is at the surface, 0 below.
        dt: time step [s].
        half_width: steps on either side of the parabola that gives a rate.
        longest: longest step of the integration [s].
    """

    pressure: Grid
    density: Grid
    temperature: Grid
    ballast: Grid
    pitch: Grid
    pitch_rate: Grid
    roll: Grid
    mass_position: Grid
    mass_angle: Grid
    afloat: Grid
    dt: float = eqx.field(static=True)
    half_width: int = eqx.field(static=True)
    longest: float = eqx.field(static=True)


@dataclasses.dataclass(frozen=True)
class Stretches:
    """The windows of a flight, and where in it their samples are.

    Attributes:
        inputs: inputs of the simulation.
        index: number of each sample in the flight, shape of the windows.
        compared: flags of the samples after the run-in, each of the flight once.
    """

    inputs: Windows
    index: np.ndarray
    compared: np.ndarray


RUN_IN = {"steady": 0.0, "driven": 60.0, "closed": 150.0}
"""Time [s] that a window of each fit runs before it is compared."""
LENGTH = 600.0
"""Time [s] of a window that is compared."""


def longest_step(flight: Flight, kind: str) -> float:
    """Longest step of the integration that is stable [s].

    Fast are speed (1.5 s), pitch (0.6 s) and, where the moving mass turns, roll: its
    damping K_p V²/I₁ takes a quarter of a second.

    Args:
        flight: the record.
        kind: kind of the fit.
    """
    if kind != "closed":
        return 1.5
    return 0.25 if flight.has("mass_angle") else 0.6


def pitch_rate(flight: Flight) -> np.ndarray:
    """Rate of the recorded pitch [rad/s]: slope of a parabola over nine seconds."""
    return slope(flight.pitch, max(round(4.5 / flight.dt), 1), flight.dt)


def cut(
    flight: Flight, kind: str, wanted: np.ndarray, whole: bool = False
) -> Stretches:
    """Windows that cover the wanted samples of a flight.

    Args:
        flight: the record.
        kind: kind of the fit; it decides how long the run-in is.
        wanted: flags of the samples that are to be compared.
        whole: flag, one window for the whole flight instead, as for a verdict: nothing
            but its very first sample is then given away.
    """
    count = len(flight.time)
    # The filter of the rates reaches over either end of what is compared.
    after = flight.half_width
    before = after + round(RUN_IN[kind] / flight.dt)
    length = count if whole else min(round(LENGTH / flight.dt), count)
    starts = np.arange(0, count, length)
    rows = starts[:, None] + np.arange(-before, length + after)[None, :]
    if whole:
        rows = np.arange(count)[None, :]
    index = np.clip(rows, 0, count - 1)
    inside = (rows >= starts[:, None]) & (rows < starts[:, None] + length)
    compared = inside & (rows < count) & wanted[index]
    used = compared.any(axis=1)
    index, compared = index[used], compared[used]
    return Stretches(
        _inputs(flight, index, longest_step(flight, kind)), index, compared
    )


def _inputs(flight: Flight, index: np.ndarray, longest: float) -> Windows:
    def rows(values: np.ndarray, default: float = 0.0) -> jax.Array:
        return jnp.asarray(np.where(np.isfinite(values), values, default)[index])

    return Windows(
        pressure=rows(flight.pressure),
        density=rows(flight.density),
        temperature=rows(flight.temperature, TEMPERATURE),
        ballast=rows(flight.ballast),
        pitch=rows(flight.pitch),
        pitch_rate=rows(pitch_rate(flight)),
        roll=rows(flight.roll),
        mass_position=rows(flight.mass_position),
        mass_angle=rows(flight.mass_angle),
        afloat=rows(flight.afloat.astype(float)),
        dt=flight.dt,
        half_width=flight.half_width,
        longest=longest,
    )
