"""The sea in tables: density over depth, currents over depth and time, a seabed.

Linear between the numbers, and as the last one beyond them. Tables are arguments of a
run like any other number: another sea of the same size compiles nothing again.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxglider.core.containers import Container, Scalar, Series, as_float, concrete
from jaxglider.signals import GliderState

Grid = Float[Array, "rows columns"]
Places = Float[Array, " places"]


def bilinear(
    row: Scalar,
    column: Scalar,
    rows: Float[Array, " rows"],
    columns: Float[Array, " columns"],
    table: Grid,
) -> Scalar:
    """Value of a table between its four nearest numbers; the nearest edge beyond it.

    Args:
        row: place along the first axis.
        column: place along the second axis.
        rows: places of the rows, rising.
        columns: places of the columns, rising.
        table: numbers.
    """
    i, s = _between(row, rows)
    j, t = _between(column, columns)
    low = (1.0 - t) * table[i, j] + t * table[i, j + 1]
    high = (1.0 - t) * table[i + 1, j] + t * table[i + 1, j + 1]
    return (1.0 - s) * low + s * high


def _between(place: Scalar, places: Places) -> tuple[jax.Array, Scalar]:
    """Number of the place below, and the share of the way to the next."""
    last = places.shape[0] - 2
    number = jnp.clip(jnp.searchsorted(places, place, side="right") - 1, 0, last)
    below, above = places[number], places[number + 1]
    return number, jnp.clip((place - below) / (above - below), 0.0, 1.0)


def _check_rising(owner: str, name: str, values: Places, least: int) -> None:
    """Refuse places that do not rise.

    Raises:
        ValueError: they do not, or are too few.
    """
    known = concrete(values)
    if np.ndim(values) != 1 or len(values) < least:
        raise ValueError(
            f"{owner}.{name} must be a list of at least {least} numbers; received "
            f"the shape {np.shape(values)}."
        )
    if known is None:
        return
    falls = np.flatnonzero(~(np.diff(known) > 0.0))
    if len(falls):
        n = int(falls[0])
        raise ValueError(
            f"{owner}.{name} must rise from each number to the next; received "
            f"{float(known[n]):g} before {float(known[n + 1]):g}."
        )


def _check_shape(owner: str, name: str, table: Array, shape: tuple[int, ...]) -> None:
    if np.shape(table) != shape:
        raise ValueError(
            f"{owner}.{name} must have the shape {shape}, that of its places; received "
            f"{np.shape(table)}."
        )


class DensityProfile(Container):
    """Density of the water over depth.

    Attributes:
        depth: depths [m], rising.
        density: density in situ at each [kg/m³].

    Raises:
        ValueError: depths do not rise, or there are not as many densities.
    """

    depth: Series = eqx.field(converter=as_float)
    density: Series = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        _check_rising("DensityProfile", "depth", self.depth, 2)
        _check_shape("DensityProfile", "density", self.density, self.depth.shape)

    def excess(self, depth: Scalar, neutral: Scalar) -> Scalar:
        """Density relative to that at neutral depth, ρ(Z)/ρ(Z₀) − 1.

        Args:
            depth: Z [m].
            neutral: Z₀ [m].
        """
        here = jnp.interp(depth, self.depth, self.density)
        there = jnp.interp(neutral, self.depth, self.density)
        return here / there - 1.0


class CurrentTable(Container):
    """Velocity of the water over time and depth.

    Attributes:
        time: times [s] from the start of the run on, rising.
        depth: depths [m], rising.
        north: velocity to the north [m/s], a row for each time.
        east: velocity to the east [m/s], a row for each time.

    Raises:
        ValueError: times or depths do not rise, or a table has another shape.
    """

    time: Series = eqx.field(converter=as_float)
    depth: Series = eqx.field(converter=as_float)
    north: Grid = eqx.field(converter=as_float)
    east: Grid = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        _check_rising("CurrentTable", "time", self.time, 2)
        _check_rising("CurrentTable", "depth", self.depth, 2)
        shape = (*self.time.shape, *self.depth.shape)
        _check_shape("CurrentTable", "north", self.north, shape)
        _check_shape("CurrentTable", "east", self.east, shape)

    def velocity(self, depth: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
        """North and east [m/s].

        Args:
            depth: Z [m], positive down.
            time: present time [s].
        """
        north, east = (
            bilinear(time, depth, self.time, self.depth, table)
            for table in (self.north, self.east)
        )
        return north, east


class SeabedGrid(Container):
    """Depth of the bottom on a grid of places.

    Attributes:
        north: places north of zero [m], rising.
        east: places east of zero [m], rising.
        depth: depth of the bottom [m], a row for each place north.

    Raises:
        ValueError: places do not rise, or the grid has another shape.
    """

    north: Series = eqx.field(converter=as_float)
    east: Series = eqx.field(converter=as_float)
    depth: Grid = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        _check_rising("SeabedGrid", "north", self.north, 2)
        _check_rising("SeabedGrid", "east", self.east, 2)
        shape = (*self.north.shape, *self.east.shape)
        _check_shape("SeabedGrid", "depth", self.depth, shape)

    def altitude(self, state: GliderState) -> Scalar:
        """Height of the glider over the bottom [m], negative once it is in it.

        Args:
            state: state of the glider.
        """
        bottom = bilinear(state.north, state.east, self.north, self.east, self.depth)
        return bottom - state.depth
