"""Start of a search: the numbers of a closed loop, moved into their sets."""

import math
from collections.abc import Callable, Collection, Sequence
from itertools import takewhile
from operator import attrgetter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.bijections import Above, Positive, Within
from tuning.space.coordinate import Coordinate
from tuning.space.coordinates import Pair, leaves

# A bijection is flat at its edge, and a search that started there would stay there for
# long: this share inside a fixed edge, and inside an edge that moves with a gain.
_INSIDE, _INSIDE_COUPLED = 0.01, 0.05
_SMALLEST, _LARGEST = 1e-12, 1e12
_FEW = 3
"""Paths that a sentence names one by one."""


def start_inside(
    loop: ClosedLoop, coordinates: Sequence[Coordinate]
) -> tuple[dict[str, float], list[str]]:
    """The tuned numbers and their partners, by path, and what was moved, in words.

    Args:
        loop: closed loop with concrete numbers, not traced.
        coordinates: coordinates of the numbers.

    Raises:
        ValueError: a number that cannot be moved into its set.
    """
    paths = [path for c in coordinates for path in (c.path, *c.partners)]
    start = {path: float(attrgetter(path)(loop)) for path in paths}
    moved: dict[str, list[str]] = {}
    with jax.enable_x64(True):
        for _, c in partners_first(coordinates):
            words = _move(c, start, [c.path for c in coordinates])
            if words:
                moved.setdefault(words, []).append(c.path)
    for c in coordinates:
        if isinstance(c.bijection, Within):
            continue
        if not _SMALLEST < start[c.path] < _LARGEST:
            raise ValueError(
                f"{c.path} must start between {_SMALLEST:g} and {_LARGEST:g} to be "
                f"tuned; received {start[c.path]:g}. Give another start, leave it "
                "out, or give a field of your own an Interval for its set."
            )
    notes = [words.format(paths=_named(where)) for words, where in moved.items()]
    return start, notes


def partners_first(
    coordinates: Sequence[Coordinate],
) -> list[tuple[int, Coordinate]]:
    """Numbered coordinates, those that another's edge depends on before that one."""
    free = {c.path: c for c in coordinates}

    def depth(c: Coordinate) -> int:
        return max((1 + depth(free[p]) for p in c.partners if p in free), default=0)

    return sorted(enumerate(coordinates), key=lambda numbered: depth(numbered[1]))


def _named(paths: Sequence[str]) -> str:
    """Paths as a reader takes them in: many that lie together by their number."""
    levels = zip(*(path.split(".") for path in paths), strict=False)
    together = [names[0] for names in takewhile(lambda x: len(set(x)) == 1, levels)]
    if len(paths) <= _FEW or not together:
        return ", ".join(paths)
    return f"{len(paths)} numbers of {'.'.join(together)}"


def edge_at(c: Coordinate, start: dict[str, float]) -> Any:
    """The edge of a number, or both, given where its partners start."""
    edge = c.edge.at(*(jnp.asarray(start[path]) for path in c.partners))
    return jax.tree.map(float, edge)


def left_broken(
    loop: ClosedLoop,
    known: Sequence[Pair],
    held: Sequence[Pair],
    names: Collection[str],
) -> list[str]:
    """Notes on the coupled sets that the start is outside of and that are not held.

    Args:
        loop: closed loop that the search starts from.
        known: all pairs.
        held: constraints that are held.
        names: paths of the tuned numbers.
    """
    notes = []
    for pair in known:
        first, second = (float(x) for x in leaves(loop, (pair.first, pair.second)))
        if pair in held or pair.second_edge.holds(second, first):
            continue
        tuned = pair.first in names or pair.second in names
        why = f"{pair.constraint} is not held" if tuned else "neither is tuned"
        notes.append(
            f"{pair.first} = {first:g} and {pair.second} = {second:g} break their "
            f"rule, {pair.second_edge.rule}: {why}."
        )
    return notes


def _move(c: Coordinate, start: dict[str, float], free: Collection[str]) -> str:
    """Move a number that is outside its set to inside; what was done, in words."""
    signed = isinstance(c.bijection, Within)
    if isinstance(c.bijection, Positive) or not (signed or start[c.path] > 0.0):
        return ""
    old, edge = start[c.path], edge_at(c, start)
    if not (signed or edge >= 0.0 or not c.partners):
        raise ValueError(
            f"no {c.path} keeps its rule, {c.edge.rule}, while {c.partners[0]} is "
            f"{start[c.partners[0]]:g}; tune both, or change the other first."
        )
    if c.bijection.has_room_for(old, edge):
        return ""
    if c.edge.moved or (signed and c.partners):
        start[c.path] = c.bijection.inside(old, edge, _INSIDE)
        plain = f"{{paths}} (set: {c.edge.rule}): the search starts from just inside."
        return c.edge.moved or plain
    if not c.partners:
        start[c.path] = c.bijection.inside(old, edge, _INSIDE)
        return (
            f"{{paths}} (set: {c.edge.rule}): the search starts from "
            f"{start[c.path]:g} instead of {old:g}, because it stays strictly inside "
            "and would hardly leave an edge."
        )
    partner, *others = c.partners
    before = start[partner]
    if isinstance(c.bijection, Above) and partner in free:
        beside = [jnp.asarray(start[path]) for path in others]
        start[partner], start[c.path] = nearest_above(
            lambda x: c.edge.at(x, *beside), before, old, _INSIDE_COUPLED
        )
    else:
        start[c.path] = c.bijection.inside(old, edge, _INSIDE_COUPLED)
    changes = f"{c.path} from {old:g} to {start[c.path]:g}"
    if start[partner] != before:
        changes = f"{partner} from {before:g} to {start[partner]:g}, {changes}"
    return (
        f"The start breaks its rule, {c.edge.rule}: the search starts from the nearest "
        f"point inside, {changes}."
    )


def nearest_above(
    edge: Callable[[Any], Any], partner: float, gain: float, step: float
) -> tuple[float, float]:
    """The point nearest in logarithms at which a gain is above its edge.

    Both may move: the partner p, and the gain up to edge(p) (1 + step). Found on a grid
    that is refined around its best point, because the set need not be convex.

    Args:
        edge: edge of the gain as a function of its partner.
        partner: starting value of the partner.
        gain: starting value of the gain, below the edge.
        step: share of the edge by which to clear it.

    Returns:
        The partner and the gain.
    """
    start, level = math.log(partner), math.log(gain)

    def needed(log_partner: np.ndarray) -> np.ndarray:
        return np.log(np.asarray(edge(jnp.exp(log_partner)))) + math.log1p(step)

    reach = float(needed(np.asarray(start))) - level
    low, high = start - reach, start + reach
    for _ in range(3):
        grid = np.linspace(low, high, 2001)
        distance = (grid - start) ** 2 + np.maximum(needed(grid) - level, 0.0) ** 2
        best = int(np.argmin(distance))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, 2000)]
    return math.exp(grid[best]), math.exp(max(level, float(needed(grid[best]))))
