"""Numbers of a closed loop that can be tuned, and the set each must stay in."""

import dataclasses
import difflib
from collections.abc import Collection, Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.sets import K1_BELOW_K2 as K1_BELOW_K2
from jaxglider.core.sets import OBSERVER_SET as OBSERVER_SET
from jaxglider.core.sets import POSITIVE as POSITIVE_NUMBERS
from jaxglider.core.sets import SECH_ABOVE_BOUND, Interval, NumberSet
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.vehicle.design_model import DesignModel
from tuning.space.bijections import Above, Below, Bijection, Positive
from tuning.space.coordinate import Coordinate
from tuning.space.edges import (
    K1_GIVEN_K2,
    K2_GIVEN_K1,
    POSITIVE,
    SECH_BOUND,
    SECH_INITIAL,
    SECH_INITIAL_ALONE,
    Edge,
    observer_integral,
    observer_proportional,
    of_interval,
)

_GUIDANCE = "scenario.reference.line_of_sight"


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of a closed loop, and the set that a field says it is in.

    Attributes:
        owner: path of the object that has the field.
        field: name of the field.
        below: path of the number below the field, with its dot; empty for itself.
        numbers: set of the field; all positive numbers where it says nothing.
    """

    owner: str
    field: str
    below: str
    numbers: NumberSet

    def beside(self, field: str) -> str:
        """Path of the number at the same place of another field of the owner."""
        return f"{self.owner}.{field}{self.below}"


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two numbers that a constraint couples.

    Attributes:
        constraint: name of the constraint.
        first: path of the number whose edge depends on the second only if the second
            is fixed (k₁, ι₁).
        second: path of the number whose edge depends on the first (k₂, ι₂).
        first_kind: bijection that keeps the first inside, given a fixed second.
        first_edge: edge of the first number's set.
        second_edge: edge of the second, which is above it.
    """

    constraint: str
    first: str
    second: str
    first_kind: Bijection
    first_edge: Edge
    second_edge: Edge


_SHOWN = 10
"""Number of groups of paths that a message lists at most."""


def tunable_paths(loop: ClosedLoop) -> tuple[str, ...]:
    """All numbers of a closed loop that can be tuned, by their dotted paths."""
    return tuple(_tunable(loop))


def expand(loop: ClosedLoop, paths: Sequence[str]) -> tuple[str, ...]:
    """Whole paths for paths that end early or have `*` for a component.

    A name alone, such as `heading`, stands for all whose path has it, wherever it is.

    Raises:
        ValueError: a path under which nothing can be tuned.
    """
    if not tunable_paths(loop):
        raise ValueError(
            f"{type(loop.controller).__name__} has no number to tune, nor has its "
            "observer: gains of a law of your own are its fields that hold a float."
        )
    known = [(path, path.split(".")) for path in tunable_paths(loop)]
    matches: dict[str, None] = {}
    for pattern in [paths] if isinstance(paths, str) else paths:
        wanted = pattern.split(".")
        under = [
            path
            for path, parts in known
            if len(wanted) <= len(parts)
            and all(w in ("*", part) for w, part in zip(wanted, parts, strict=False))
        ]
        under = under or [path for path, parts in known if pattern in parts]
        if not under:
            raise ValueError(_unknown(pattern, [path for path, _ in known]))
        matches.update(dict.fromkeys(under))
    if not matches:
        raise ValueError("paths is empty; name at least one number to tune.")
    return tuple(matches)


def pairs(loop: ClosedLoop, bounds: BodyAxes[Any] | None) -> Iterator[Pair]:
    """All pairs of numbers that a named constraint can couple.

    Args:
        loop: the closed loop.
        bounds: bounds on the rate of the disturbance of each axis [N/s, N m/s].
    """
    for path, number in _tunable(loop).items():
        coupled = number.numbers
        if isinstance(coupled, Interval) or number.field != coupled.first:
            continue
        partner = number.beside(coupled.second)
        if coupled.rule == K1_BELOW_K2:
            yield Pair(K1_BELOW_K2, path, partner, Below(), K1_GIVEN_K2, K2_GIVEN_K1)
        elif coupled.rule == OBSERVER_SET and bounds is not None:
            bound = float(getattr(bounds, path.rpartition(".")[2]))
            yield Pair(
                OBSERVER_SET,
                path,
                partner,
                Above(),
                observer_proportional(bound),
                observer_integral(bound),
            )


def coordinates(
    loop: ClosedLoop,
    names: Collection[str],
    coupled: Collection[Pair],
    prescribed: Mapping[str, Coordinate] | None = None,
) -> tuple[Coordinate, ...]:
    """Coordinates of the tuned numbers, each of which keeps its number in its set.

    Args:
        loop: the closed loop.
        names: dotted paths of the tuned numbers.
        coupled: pairs to hold.
        prescribed: coordinates that a specification asks for, by path; they stand
            before all others.
    """
    tunable = _tunable(loop)
    by_first = {pair.first: pair for pair in coupled}
    by_second = {pair.second: pair for pair in coupled}

    def of(path: str) -> Coordinate:
        if prescribed and path in prescribed:
            return prescribed[path]
        if path in by_second:
            pair = by_second[path]
            return Coordinate(path, Above(), pair.second_edge, (pair.first,))
        if path in by_first and by_first[path].second not in names:
            pair = by_first[path]
            return Coordinate(path, pair.first_kind, pair.first_edge, (pair.second,))
        return _by_itself(path, tunable[path], names)

    return tuple(of(path) for path in names)


def _by_itself(path: str, number: Number, names: Collection[str]) -> Coordinate:
    """The coordinate of a number in the set of its own field."""
    numbers = number.numbers
    if isinstance(numbers, Interval):
        return Coordinate(path, *of_interval(numbers))
    if numbers.rule != SECH_ABOVE_BOUND:
        return Coordinate(path, Positive(), POSITIVE)
    if number.field == numbers.second:
        return Coordinate(path, Below(), SECH_BOUND, (number.beside(numbers.first),))
    bound = number.beside(numbers.second)
    if bound in names:
        return Coordinate(path, Below(), SECH_INITIAL_ALONE)
    return Coordinate(path, Below(), SECH_INITIAL, (bound,))


def _tunable(loop: ClosedLoop) -> dict[str, Number]:
    """Each tunable number, by its path."""
    numbers = dict(_numbers(loop.controller, "controller"))
    numbers.update(_numbers(loop.observer, "observer"))
    numbers.update(_numbers(loop.estimator, "estimator"))
    guidance = getattr(loop.scenario.reference, _GUIDANCE.rpartition(".")[2], None)
    numbers.update(_numbers(guidance, _GUIDANCE))
    return numbers


def _numbers(
    module: Any, path: str, above: Number | None = None
) -> Iterator[tuple[str, Number]]:
    """The tunable numbers of an object, by path.

    Args:
        module: object to look into.
        path: dotted path of the number.
        above: field that holds the object, where that field says in which set all
            numbers below it are.
    """
    if not isinstance(module, eqx.Module) or isinstance(module, DesignModel):
        return
    for field in dataclasses.fields(module):
        value, about = getattr(module, field.name), field.metadata
        if about.get("static", False) or not about.get("tuned", True):
            continue
        here = f"{path}.{field.name}"
        number = Number(path, field.name, "", about.get("set", POSITIVE_NUMBERS))
        if "set" not in about and above is not None:
            number = dataclasses.replace(above, below=f"{above.below}.{field.name}")
        if isinstance(value, eqx.Module):
            inherited = "set" in about or above is not None
            yield from _numbers(value, here, number if inherited else None)
        elif (
            isinstance(value, jax.Array)
            and value.shape == ()
            and jnp.issubdtype(value.dtype, jnp.floating)
        ):
            yield here, number


def leaves(loop: ClosedLoop, paths: Sequence[str]) -> list[Any]:
    """The arrays at whole paths."""
    return [attrgetter(path)(loop) for path in paths]


def _unknown(pattern: str, known: list[str]) -> str:
    groups = {".".join(path.split(".")[:n]) for path in known for n in range(1, 6)}
    # A path from within, such as gains.heading, is meant as an end.
    near = sorted(g for g in groups if g.endswith(f".{pattern}"))
    near = near or difflib.get_close_matches(pattern, sorted(groups), 3)
    words = {part for path in known for part in path.split(".")}
    near = near or difflib.get_close_matches(pattern, sorted(words), 3)
    if near:
        return (
            f"{pattern!r} names nothing to tune in this closed loop; did you mean "
            f"{' or '.join(near[:_SHOWN])}? Below {', '.join(_heads(known))} there are "
            f"{len(known)} numbers."
        )
    heads = _heads(known)
    more = ", ..." if len(heads) > _SHOWN else ""
    return (
        f"{pattern!r} names nothing to tune in this closed loop; "
        f"choose from {', '.join(heads[:_SHOWN])}{more} or a number below one of them "
        f"({len(known)} in all)."
    )


def _heads(known: list[str]) -> list[str]:
    return sorted({".".join(path.split(".")[:2]) for path in known})
