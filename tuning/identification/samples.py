"""Samples of a record that are compared, and the model's answer to them, linearised."""

import copy
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.kept.programs import kept
from tuning.identification.glider import IdentifiedGlider, with_values
from tuning.identification.information.least_squares import Rows
from tuning.identification.parameters import FreeParameter, value_at
from tuning.identification.predict import predict
from tuning.identification.record.slopes import slope
from tuning.identification.record.uniform import Flight
from tuning.identification.stages import TURNING
from tuning.identification.windows import Stretches, Windows

STRIDE = 5.0
"""Time between samples of a smoothed channel that enter the fit [s]."""
TRUSTED = 0.1
"""Largest distance of a measured speed from the median of all [m/s]."""


def compared(flight: Flight, kind: str) -> np.ndarray:
    """Flags of the samples that a kind of fit compares."""
    return flight.steady if kind == "steady" else flight.good


def measured_channel(flight: Flight, name: str) -> np.ndarray:
    """A channel as measured, NaN where it cannot be compared.

    Args:
        flight: the record.
        name: name of the channel.
    """
    if name == "turn_rate":
        return slope(flight.heading, flight.half_width, flight.dt)
    values = np.asarray(getattr(flight, name))
    if name != "speed":
        return values
    middle = np.nanmedian(values) if np.isfinite(values).any() else np.nan
    return np.where(np.abs(values - middle) < TRUSTED, values, np.nan)


def chosen_rows(
    flight: Flight, stretches: Stretches, groups: Sequence[str]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Values of some groups of samples, their places, and their unbroken stretches.

    Args:
        flight: the record.
        stretches: windows of the flight.
        groups: names of channels, with `TURNING` behind for the samples of turns.
    """
    flat = stretches.index.ravel()
    flags = stretches.compared.ravel()
    steady = flight.steady[flat]
    every = max(round(STRIDE / flight.dt), 1)
    measured, rows, unbroken = {}, {}, {}
    for group in groups:
        name = group.removesuffix(TURNING)
        values = measured_channel(flight, name)[flat]
        those = steady if group == name else ~steady
        chosen = flags & np.isfinite(values) & those
        if name != "speed":
            chosen &= flat % every == 0
        places = np.flatnonzero(chosen)
        if len(places) < 30:
            continue
        places = places[np.argsort(flat[places], kind="stable")]
        measured[group], rows[group] = values[places], places
        step = np.diff(flat[places], prepend=flat[places[0]])
        unbroken[group] = np.cumsum(step > 1.5 * max(np.median(step), 1.0))
    return measured, rows, unbroken


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

    def changed(self, change: Callable[[Windows], Windows]) -> "Linearised":
        """The same rows of a flight with other inputs; nothing is compiled again."""
        other = copy.copy(self)
        glider, windows = self._arguments
        other._arguments = (glider, change(windows))
        return other

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


@kept
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
        moved = with_values(
            glider,
            {
                name: value_at(starts[k], priors[k], at[k], signed=signed)
                for k, (name, signed) in enumerate(look)
            },
        )
        every = predict(kind, moved, windows)
        chosen = {
            group: every[group.removesuffix(TURNING)].ravel()[places]
            for group, places in rows.items()
        }
        return chosen, chosen

    slopes, chosen = jax.jacfwd(values, has_aux=True)(x)
    return chosen, slopes


@kept
def predicted(kind: str, glider: IdentifiedGlider, windows: Windows) -> dict[str, Any]:
    """Predicted channels, compiled once for each shape.

    Args:
        kind: kind of the fit.
        glider: the glider.
        windows: inputs from the record.
    """
    return predict(kind, glider, windows)
