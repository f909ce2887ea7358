"""Tuned numbers of a closed loop, and the free numbers that stand for them.

A number is named by its dotted path, `controller.gains.depth.k1`; a path may end early
or have `*` for a component. Whatever the free numbers are, the closed loop they are
written to has every tuned number in the set the theory asks for: see `bijections`.

Sets that couple gains are held by name:

- `k1-below-k2-squared`: k₁ < ¾ k₂² of the fixed-time law; by default.
- `observer-set`: ι₁ and ι₂ of the observer, given a bound on the disturbance's rate.
- `inside-specification`, `restart-inside`, `surface-settles`, `equal-edges`: see
  `prescribed`.

Gains that start outside are moved to the nearest point inside, in logarithms, and the
space says so in its notes.
"""

import dataclasses
import functools
import re
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
from tuning.space.coordinate import Coordinate
from tuning.space.coordinates import (
    K1_BELOW_K2,
    OBSERVER_SET,
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
from tuning.space.prescribed import EQUAL_EDGES, PRESCRIBED, prescribed

STABLE_LOOP = "stable-loop"
"""Constraint on the choice among the steps of a search; no number's set has it."""
HELD_BY_DEFAULT = (K1_BELOW_K2, *PRESCRIBED, STABLE_LOOP)
"""Names of the constraints that `tune` holds where nothing else is asked for."""
CONSTRAINTS = (*HELD_BY_DEFAULT, OBSERVER_SET, EQUAL_EDGES)
"""Names of all constraints."""


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
        names, followers = _tied(names, EQUAL_EDGES in constraints)
        specified, notes = prescribed(loop, names, constraints)
        space = cls(
            tuple(
                dataclasses.replace(c, followers=followers.get(c.path, ()))
                for c in coordinates(loop, names, held, specified)
            )
        )
        notes += start_inside(loop, space.coordinates)[1]
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
            edges = [edge_at(c, start) for c in self.coordinates]
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
            partners = [
                written[path] if path in written else attrgetter(path)(loop)
                for path in c.partners
            ]
            written[c.path] = c.bijection.place(
                grown[c.bijection][n], c.edge.at(*partners)
            )
            written.update(dict.fromkeys(c.followers, written[c.path]))
        names = tuple(written)
        old = leaves(loop, names)
        new = [
            jnp.asarray(written[name], leaf.dtype)
            for name, leaf in zip(names, old, strict=True)
        ]
        return eqx.tree_at(lambda at: leaves(at, names), loop, new)

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
            partners = [float(x) for x in leaves(loop, c.partners)]
            if not (np.isfinite(value) and c.edge.holds(value, *partners)):
                beside = ", ".join(
                    f"{path} = {x:g}"
                    for path, x in zip(c.partners, partners, strict=True)
                )
                beside = f" with {beside}" if beside else ""
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


def _tied(
    names: Sequence[str], equal_edges: bool
) -> tuple[tuple[str, ...], dict[str, tuple[str, ...]]]:
    """Names without those that follow another, and the followers of each."""
    sides = {
        f"{name.rpartition('.')[0]}.lower": name
        for name in names
        if equal_edges and re.search(r"\.transformation\.\w+\.upper$", name)
    }
    followers: dict[str, tuple[str, ...]] = {
        low: (high,) for low, high in sides.items() if low in names
    }
    gone = {high for tied in followers.values() for high in tied}
    return tuple(name for name in names if name not in gone), followers


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
