"""Tuned numbers of a closed loop, and the free numbers that stand for them.

A number is named by its dotted path, `controller.gains.depth.k1`; a path may end early
or have `*` for a component. Whatever the free numbers are, the closed loop they are
written to has every tuned number in the set the theory asks for: see `bijections`.

Two of the theory's sets couple gains and are held by name:

- `k1-below-k2-squared`: k₁ < ¾ k₂² of the fixed-time law; by default.
- `observer-set`: ι₁ and ι₂ of the observer, given a bound on the disturbance's rate.

Gains that start outside are moved to the nearest point inside, in logarithms, and the
space says so in its notes.
"""

import dataclasses
import functools
from collections.abc import Collection, Sequence
from operator import attrgetter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Series
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.bijections import Bijection, bend, unbend
from tuning.space.coordinates import (
    CONSTRAINTS,
    K1_BELOW_K2,
    OBSERVER_SET,
    Coordinate,
    coordinates,
    expand,
    leaves,
    pairs,
)
from tuning.space.feasible_start import (
    edge_at,
    left_broken,
    partners_first,
    start_inside,
)


@dataclasses.dataclass(frozen=True)
class Space:
    """Some numbers of a closed loop as one vector of free numbers. Make it with `of`.

    Attributes:
        coordinates: coordinates, one for each free number.
        notes: sentences for the user: what was moved into its set, and what is not
            held.
    """

    coordinates: tuple[Coordinate, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        paths: Sequence[str],
        constraints: Collection[str] = (K1_BELOW_K2,),
        disturbance_rate_bound: BodyAxes[Any] | None = None,
    ) -> "Space":
        """The space of the numbers at some paths of a closed loop.

        Args:
            loop: closed loop that the search starts from.
            paths: dotted paths from the closed loop; see `tunable_paths`.
            constraints: names of the coupled sets to hold.
            disturbance_rate_bound: bound on the rate of each axis' disturbance [N/s, N
                m/s], for `observer-set`.

        Raises:
            ValueError: an unknown path or constraint, a bound that is missing, not
                needed or out of range, or a start that cannot be moved into its set.
        """
        _check_constraints(constraints, disturbance_rate_bound)
        names = expand(loop, paths)
        known = list(pairs(loop, disturbance_rate_bound))
        held = [
            pair
            for pair in known
            if pair.constraint in constraints and {pair.first, pair.second} & set(names)
        ]
        space = cls(coordinates(loop, names, held))
        notes = [*start_inside(loop, space.coordinates)[1]]
        notes += left_broken(loop, known, held, names)
        if OBSERVER_SET in constraints and not any(
            pair.constraint == OBSERVER_SET for pair in known
        ):
            kind = type(loop.observer).__name__
            notes.append(f"{OBSERVER_SET} has nothing to hold in a {kind}.")
        return dataclasses.replace(space, notes=tuple(notes))

    @property
    def names(self) -> tuple[str, ...]:
        """Whole dotted paths, in the order of the free numbers."""
        return tuple(c.path for c in self.coordinates)

    def read(self, loop: ClosedLoop) -> Series:
        """The free numbers of a closed loop, moved into its sets; not to be traced.

        Raises:
            ValueError: a number that cannot be moved into its set.
        """
        start, _ = start_inside(loop, self.coordinates)
        with jax.enable_x64(True):
            edges = [float(edge_at(c, start)) for c in self.coordinates]
        bent = [
            c.bijection.inverse(start[c.path], edge)
            for c, edge in zip(self.coordinates, edges, strict=True)
        ]
        return jnp.asarray(
            unbend(np.array(bent)), jnp.result_type(*leaves(loop, self.names))
        )

    def write(self, loop: ClosedLoop, free: Series) -> ClosedLoop:
        """The closed loop with the numbers that the free numbers stand for."""
        # All at once first, then number by number: the latter alone compiles slowly.
        kinds = tuple(dict.fromkeys(c.bijection for c in self.coordinates))
        grown = dict(zip(kinds, _stretched(kinds, free), strict=True))
        written: dict[str, Any] = {}
        for n, c in partners_first(self.coordinates):
            partner = None
            if c.partner is not None:
                partner = written.get(c.partner, attrgetter(c.partner)(loop))
            written[c.path] = c.bijection.place(
                grown[c.bijection][n], c.edge.at(partner)
            )
        old = leaves(loop, self.names)
        new = [
            jnp.asarray(written[name], leaf.dtype)
            for name, leaf in zip(self.names, old, strict=True)
        ]
        return eqx.tree_at(lambda at: leaves(at, self.names), loop, new)

    def values(self, loop: ClosedLoop) -> dict[str, float]:
        """The tuned numbers of a closed loop, by path."""
        return {
            name: float(leaf)
            for name, leaf in zip(self.names, leaves(loop, self.names), strict=True)
        }

    def bounds_hold(self, loop: ClosedLoop) -> list[str]:
        """The rules a closed loop breaks among those held here; empty when none."""
        broken = []
        for c in self.coordinates:
            value = float(attrgetter(c.path)(loop))
            partner = float(attrgetter(c.partner)(loop)) if c.partner else 0.0
            if not (np.isfinite(value) and c.edge.holds(value, partner)):
                beside = f" with {c.partner} = {partner:g}" if c.partner else ""
                broken.append(
                    f"{c.path} = {value:g}{beside} breaks its rule: {c.edge.rule}."
                )
        return broken


# Compiled as one, not operation by operation where nothing is traced.
@functools.partial(jax.jit, static_argnums=0)
def _stretched(kinds: tuple[Bijection, ...], free: Series) -> list[Series]:
    """The part of all gains that does not need the edge, for each kind."""
    bent = bend(free)
    return [kind.stretch(bent) for kind in kinds]


def _check_constraints(
    constraints: Collection[str], disturbance_rate_bound: BodyAxes[Any] | None
) -> None:
    for name in constraints:
        if name not in CONSTRAINTS:
            raise ValueError(
                f"constraints must be among {', '.join(CONSTRAINTS)}; "
                f"received {name!r}."
            )
    bounded = disturbance_rate_bound is not None
    if bounded != (OBSERVER_SET in constraints):
        raise ValueError(
            f"{OBSERVER_SET} and disturbance_rate_bound go together; received "
            + ("the bound alone." if bounded else "the constraint alone.")
        )
    for axis, bound in vars(disturbance_rate_bound).items() if bounded else ():
        if not 0.0 < float(bound) <= 1e4:
            raise ValueError(
                f"disturbance_rate_bound.{axis} must be in (0, 10000]; "
                f"received {float(bound):g}."
            )
