"""One fit: a vehicle, a flight, a kind, and which of its dives are held out."""

import dataclasses
import time
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import choose
from jaxglider.vehicle.parameters import VehicleData
from tuning.identification.glider import IdentifiedGlider, starting_glider
from tuning.identification.least_squares import Rows, Solution, solve
from tuning.identification.parameters import (
    FreeParameter,
    default_names,
    free_parameters,
    placed,
)
from tuning.identification.predict import KINDS, predict
from tuning.identification.record.uniform import Flight
from tuning.identification.windows import Stretches, Windows, cut

SPLITS = ("half", "alternate")
"""Ways of holding dives out: the second half of them, or every other one."""
STRIDE = 5.0
"""Time between samples of a smoothed channel that enter the fit [s]."""
TRUSTED = 0.1
"""Largest distance of a measured speed from the median of all [m/s]."""


@dataclasses.dataclass(frozen=True)
class Plan:
    """The task of a fit: free numbers, channels, and dives held out.

    Attributes:
        kind: kind of the fit.
        free: free numbers.
        channels: channels that are fitted.
        split: way of holding dives out.
        held_out: numbers of the dives that are held out.
    """

    kind: str
    free: tuple[FreeParameter, ...]
    channels: tuple[str, ...]
    split: str
    held_out: tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Fit:
    """A fitted glider.

    Attributes:
        plan: task of the fit.
        vehicle: vehicle file that it started from.
        flight: the record on one clock.
        before: glider as it started.
        after: glider as fitted.
        solution: coordinates, covariance and noise.
        seconds: time that it took [s], compiling included.
    """

    plan: Plan
    vehicle: VehicleData
    flight: Flight
    before: IdentifiedGlider
    after: IdentifiedGlider
    solution: Solution
    seconds: float


def held_out_dives(dives: int, split: str) -> tuple[int, ...]:
    """Numbers of the dives that are held out, of those counted from 1.

    Args:
        dives: number of dives.
        split: `half` or `alternate`.

    Raises:
        ValueError: the split has another name.
    """
    choose("split", split, SPLITS)
    if split == "half":
        return tuple(range(dives // 2 + 1, dives + 1))
    return tuple(range(2, dives + 1, 2))


def fitted_channels(flight: Flight, kind: str, speed: bool) -> tuple[str, ...]:
    """Channels of the record that a fit compares.

    Args:
        flight: the record.
        kind: kind of the fit.
        speed: whether a recorded speed is used.
    """
    names = ["depth_rate"]
    if speed and flight.has("speed"):
        names.append("speed")
    if kind == "closed":
        names.append("pitch")
        if flight.has("mass_angle"):
            names += ["roll", "turn_rate"] if flight.has("heading") else ["roll"]
    return tuple(names)


def measured_channel(flight: Flight, name: str) -> np.ndarray:
    """A channel as measured, NaN where it cannot be compared.

    Args:
        flight: the record.
        name: name of the channel.
    """
    if name == "turn_rate":
        return _turn_rate(flight)
    values = np.asarray(getattr(flight, name))
    if name != "speed":
        return values
    middle = np.nanmedian(values) if np.isfinite(values).any() else np.nan
    return np.where(np.abs(values - middle) < TRUSTED, values, np.nan)


def _turn_rate(flight: Flight) -> np.ndarray:
    half = flight.half_width
    weights = np.arange(-half, half + 1) / (
        flight.dt * half * (half + 1) * (2 * half + 1) / 3
    )
    padded = np.pad(flight.heading, half, mode="edge")
    return np.convolve(padded, weights[::-1], mode="valid")


def make_plan(
    flight: Flight,
    vehicle: VehicleData,
    before: IdentifiedGlider,
    kind: str = "driven",
    free: Sequence[str] = (),
    speed: bool = True,
    split: str = "half",
) -> Plan:
    """Decide what is free, what is compared, and what is held out.

    Args:
        flight: the record.
        vehicle: vehicle file.
        before: glider as the fit starts from it.
        kind: kind of the fit.
        free: names of free numbers; by default those that the record may tell.
        speed: whether a recorded speed is used.
        split: way of holding dives out.

    Raises:
        ValueError: the record lacks what the kind needs, or a name is unknown.
    """
    choose("kind", kind, KINDS)
    if kind == "closed" and not flight.has("mass_position"):
        raise ValueError(
            "kind: the closed fit needs mass_position, the place of the moving mass, "
            "which the record lacks; use driven."
        )
    if kind == "closed" and vehicle.body is None:
        raise ValueError(
            f"kind: the closed fit needs a vehicle with a table [body]; {vehicle.name} "
            "has none. `jaxglider vehicles --show seawing` prints one."
        )
    channels = fitted_channels(flight, kind, speed)
    names = free or default_names(
        kind,
        "speed" in channels,
        float(np.percentile(flight.depth[flight.good], 98)),
        "roll" in channels,
    )
    return Plan(
        kind,
        free_parameters(names, before, vehicle),
        channels,
        split,
        held_out_dives(flight.dives(), split),
    )


def fit_flight(
    flight: Flight,
    vehicle: VehicleData,
    volume: float | None = None,
    kind: str = "driven",
    free: Sequence[str] = (),
    speed: bool = True,
    split: str = "half",
) -> Fit:
    """Fit a vehicle to a flight.

    Args:
        flight: the record on one clock.
        vehicle: vehicle to start from; its doubts are the priors.
        volume: V [m³]; by default the vehicle's mass over the record's mean density.
        kind: `steady`, `driven` or `closed`.
        free: names of free numbers; by default those that the record may tell.
        speed: whether a recorded speed is used.
        split: `half` or `alternate`, the dives held out.

    Raises:
        ValueError: the record lacks what is needed, or an argument cannot be used.
        FloatingPointError: the model is not finite where the fit begins.
    """
    begun = time.monotonic()
    before = starting_glider(vehicle, flight, volume)
    plan = make_plan(flight, vehicle, before, kind, free, speed, split)
    wanted = compared(flight, kind) & ~np.isin(flight.dive, plan.held_out)
    if wanted.sum() * flight.dt < 300.0:
        raise ValueError(
            "the record must have five minutes of gliding that can be compared; it has "
            f"{wanted.sum() * flight.dt:.0f} s. See `jaxglider record` for its gaps."
        )
    stretches = cut(flight, kind, wanted)
    measured, rows = _rows(flight, stretches, plan.channels)
    model = Linearised(before, plan.free, stretches.inputs, kind, rows)
    solution = solve(model, measured, len(plan.free))
    after = placed(before, plan.free, jnp.asarray(solution.x))
    return Fit(plan, vehicle, flight, before, after, solution, time.monotonic() - begun)


def compared(flight: Flight, kind: str) -> np.ndarray:
    """Flags of the samples that a kind of fit compares."""
    return flight.steady if kind == "steady" else flight.good


_ONLY_STEADY = ("depth_rate:turning", "speed:turning")
TURNING = ":turning"
"""Ending of a group of samples that are not of a steady glide."""


def _rows(
    flight: Flight, stretches: Stretches, channels: Sequence[str]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Measured values that are compared, and their places in the windows.

    Depth rate and speed are fitted in steady glides only, and judged in turns too: what
    the model leaves out of a turn would move mass and drag. Attitude in turns is a
    group of its own, for its noise is another.
    """
    flat = stretches.index.ravel()
    flags = stretches.compared.ravel()
    steady = flight.steady[flat]
    every = max(round(STRIDE / flight.dt), 1)
    measured, rows = {}, {}
    for name in channels:
        values = measured_channel(flight, name)[flat]
        for group, those in ((name, steady), (name + TURNING, ~steady)):
            chosen = flags & np.isfinite(values) & those
            if name != "speed":
                chosen &= flat % every == 0
            places = np.flatnonzero(chosen)
            if len(places) < 10 or group in _ONLY_STEADY:
                continue
            places = places[np.argsort(flat[places], kind="stable")]
            measured[group], rows[group] = values[places], places
    return measured, rows


class Linearised:
    """Predicted rows and their Jacobian at some coordinates.

    Programs are shared between fits of one shape: numbers are arguments.
    """

    def __init__(
        self,
        glider: IdentifiedGlider,
        free: tuple[FreeParameter, ...],
        windows: Windows,
        kind: str,
        rows: Rows,
    ) -> None:
        self._arguments = (glider, windows)
        self._rows = {name: jnp.asarray(places) for name, places in rows.items()}
        self._free, self._kind = free, kind

    def __call__(self, x: np.ndarray) -> tuple[dict[str, Any], dict[str, Any]]:
        """Rows and Jacobian at x."""
        starts = jnp.asarray([p.start for p in self._free])
        priors = jnp.asarray([p.prior for p in self._free])
        look = tuple((p.name, p.signed) for p in self._free)
        values, slopes = _linearise(
            jnp.asarray(x),
            starts,
            priors,
            *self._arguments,
            self._rows,
            look,
            self._kind,
        )
        return (
            {name: np.asarray(v) for name, v in values.items()},
            {name: np.asarray(v) for name, v in slopes.items()},
        )


@eqx.filter_jit
def _linearise(
    x: jax.Array,
    starts: jax.Array,
    priors: jax.Array,
    glider: IdentifiedGlider,
    windows: Windows,
    rows: dict[str, jax.Array],
    look: tuple[tuple[str, bool], ...],
    kind: str,
) -> tuple[dict[str, jax.Array], dict[str, jax.Array]]:
    def values(at: jax.Array) -> tuple[dict[str, jax.Array], dict[str, jax.Array]]:
        moved = _placed(glider, starts, priors, look, at)
        every = predict(kind, moved, windows)
        chosen = {
            group: every[group.removesuffix(TURNING)].ravel()[places]
            for group, places in rows.items()
        }
        return chosen, chosen

    slopes, chosen = jax.jacfwd(values, has_aux=True)(x)
    return chosen, slopes


def _placed(
    glider: IdentifiedGlider,
    starts: jax.Array,
    priors: jax.Array,
    look: tuple[tuple[str, bool], ...],
    x: jax.Array,
) -> IdentifiedGlider:
    from tuning.identification.glider import with_values

    values = {}
    for k, (name, signed) in enumerate(look):
        if signed:
            values[name] = starts[k] * jnp.exp(priors[k] / jnp.abs(starts[k]) * x[k])
        else:
            values[name] = starts[k] + priors[k] * x[k]
    return with_values(glider, values)


@eqx.filter_jit
def predicted(kind: str, glider: IdentifiedGlider, windows: Windows) -> dict[str, Any]:
    """Predicted channels, compiled once for each shape.

    Args:
        kind: kind of the fit.
        glider: the glider.
        windows: inputs from the record.
    """
    return predict(kind, glider, windows)
