"""The place that the positions of a run count from.

A program in single precision cannot move a glider at 5,432,100 m north: the next number
is half a metre away. So traced positions are small, counted from a place that the host
keeps in double precision: taken off where a mission is read, put back where results are
written. Depth needs none: at 6000 m single precision still resolves half a millimetre.
"""

import dataclasses
from typing import TypeVar

import equinox as eqx
import numpy as np

Run = TypeVar("Run")

NEAR = 1000.0
"""Starts up to here from zero, north and east, count from zero [m]."""


@dataclasses.dataclass(frozen=True)
class Origin:
    """The place that is north zero, east zero within a run.

    Attributes:
        north: true position of it [m].
        east: true position of it [m].
        place: latitude and longitude of it [deg], or None for nowhere on Earth.
    """

    north: float = 0.0
    east: float = 0.0
    place: tuple[float, float] | None = None

    @property
    def moved(self) -> bool:
        """Whether it is another place than zero."""
        return (self.north, self.east) != (0.0, 0.0)

    @classmethod
    def at_start(cls, north: float, east: float) -> "Origin":
        """The start of a glider, or zero where that is near enough."""
        far = max(abs(north), abs(east)) > NEAR
        return cls(north, east) if far else MAP_ZERO

    def on_the_map(self, run: Run) -> Run:
        """A trajectory with its true positions, in double precision.

        Args:
            run: anything with `ticks.state`, on the host.
        """
        if not self.moved:
            return run
        state = run.ticks.state  # type: ignore[attr-defined]
        places = (
            np.asarray(state.north, np.float64) + self.north,
            np.asarray(state.east, np.float64) + self.east,
        )
        moved = eqx.tree_at(
            lambda r: (r.ticks.state.north, r.ticks.state.east), run, places
        )
        onboard = getattr(run.ticks, "onboard", None)  # type: ignore[attr-defined]
        if onboard is None:
            return moved
        (north, east), known = onboard.fix, onboard.estimate
        believed = (known.north, known.east, north, east)
        whole = tuple(
            np.asarray(x, np.float64) + shift
            for x, shift in zip(believed, (self.north, self.east) * 2, strict=True)
        )
        return eqx.tree_at(
            lambda r: (
                r.ticks.onboard.estimate.north,
                r.ticks.onboard.estimate.east,
                *r.ticks.onboard.fix,
            ),
            moved,
            whole,
        )


MAP_ZERO = Origin()
"""Positions that are true ones as they stand."""
