"""Numbers of a closed loop that can be tuned, and the set each must stay in."""

import dataclasses
import difflib
from collections.abc import Collection, Iterator, Sequence
from operator import attrgetter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control import SMC, ChannelGains, RollAwareFxTPPC
from jaxglider.control.observer import FixedTimeObserver
from jaxglider.control.performance import ExponentialFunction, SechFunction
from jaxglider.control.transform import ErrorTransformation
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.bijections import (
    ABOVE_ONE,
    FROM_ONE,
    K1_GIVEN_K2,
    K2_GIVEN_K1,
    POSITIVE,
    QUARTER_TURN,
    SECH_BOUND,
    SECH_INITIAL,
    SECH_INITIAL_ALONE,
    UNIT,
    UNIT_CLOSED,
    Above,
    Below,
    Bijection,
    Edge,
    Positive,
    observer_integral,
    observer_proportional,
)

K1_BELOW_K2 = "k1-below-k2-squared"
OBSERVER_SET = "observer-set"
CONSTRAINTS = (K1_BELOW_K2, OBSERVER_SET)

_GUIDANCE = "scenario.reference.line_of_sight"
_LEFT_OUT = {"model", "smoothing", "tail"}


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One tuned number.

    Attributes:
        path: dotted path from the closed loop.
        bijection: bijection between the number and its free number.
        edge: edge of its set.
        partner: path of the number its edge depends on, if any.
    """

    path: str
    bijection: Bijection
    edge: Edge
    partner: str | None = None


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


def tunable_paths(loop: ClosedLoop) -> tuple[str, ...]:
    """All numbers of a closed loop that can be tuned, by their dotted paths."""
    return tuple(_owners(loop))


def expand(loop: ClosedLoop, paths: Sequence[str]) -> tuple[str, ...]:
    """Whole paths for paths that end early or have `*` for a component.

    Raises:
        ValueError: a path under which nothing can be tuned.
    """
    known = [(path, path.split(".")) for path in tunable_paths(loop)]
    found: dict[str, None] = {}
    for given in [paths] if isinstance(paths, str) else paths:
        wanted = given.split(".")
        under = [
            path
            for path, parts in known
            if len(wanted) <= len(parts)
            and all(w in ("*", part) for w, part in zip(wanted, parts, strict=False))
        ]
        if not under:
            raise ValueError(_unknown(given, [path for path, _ in known]))
        found.update(dict.fromkeys(under))
    if not found:
        raise ValueError("paths is empty; name at least one number to tune.")
    return tuple(found)


def pairs(loop: ClosedLoop, bounds: BodyAxes[Any] | None) -> Iterator[Pair]:
    """All pairs of numbers that a named constraint can couple.

    Args:
        loop: the closed loop.
        bounds: bounds on the rate of the disturbance of each axis [N/s, N m/s].
    """
    for path, (owner, name) in _owners(loop).items():
        base = path.rpartition(".")[0]
        if isinstance(owner, ChannelGains) and name == "k1":
            yield Pair(
                K1_BELOW_K2, path, f"{base}.k2", Below(), K1_GIVEN_K2, K2_GIVEN_K1
            )
    if isinstance(loop.observer, FixedTimeObserver) and bounds is not None:
        for axis, bound in vars(bounds).items():
            yield Pair(
                OBSERVER_SET,
                f"observer.proportional.{axis}",
                f"observer.integral.{axis}",
                Above(),
                observer_proportional(float(bound)),
                observer_integral(float(bound)),
            )


def coordinates(
    loop: ClosedLoop, names: Collection[str], coupled: Collection[Pair]
) -> tuple[Coordinate, ...]:
    """Coordinates of the tuned numbers, each of which keeps its number in its set.

    Args:
        loop: the closed loop.
        names: dotted paths of the tuned numbers.
        coupled: pairs to hold.
    """
    owners = _owners(loop)
    by_first = {pair.first: pair for pair in coupled}
    by_second = {pair.second: pair for pair in coupled}

    def of(path: str) -> Coordinate:
        if path in by_second:
            pair = by_second[path]
            return Coordinate(path, Above(), pair.second_edge, pair.first)
        if path in by_first and by_first[path].second not in names:
            pair = by_first[path]
            return Coordinate(path, pair.first_kind, pair.first_edge, pair.second)
        return _by_itself(path, *owners[path], names)

    return tuple(of(path) for path in names)


def _by_itself(path: str, owner: Any, name: str, names: Collection[str]) -> Coordinate:
    """The set a number is in by its own kind."""
    base = path.rpartition(".")[0]
    match owner, name:
        case ChannelGains(), "rho":
            return Coordinate(path, Below(), UNIT)
        case ChannelGains(), "mu":
            return Coordinate(path, Above(), ABOVE_ONE)
        case RollAwareFxTPPC(), "largest_angle":
            return Coordinate(path, Below(), QUARTER_TURN)
        case (RollAwareFxTPPC(), "hedging") | (ErrorTransformation(), _):
            return Coordinate(path, Below(), UNIT_CLOSED)
        case ExponentialFunction(), "initial":
            return Coordinate(path, Above(), FROM_ONE)
        case SechFunction(), "final_bound":
            return Coordinate(path, Below(), SECH_BOUND, f"{base}.initial")
        case SechFunction(), "initial":
            bound = f"{base}.final_bound"
            if bound in names:
                return Coordinate(path, Below(), SECH_INITIAL_ALONE)
            return Coordinate(path, Below(), SECH_INITIAL, bound)
    return Coordinate(path, Positive(), POSITIVE)


def _owners(loop: ClosedLoop) -> dict[str, tuple[Any, str]]:
    """Owner and field name of each tunable number, by path."""
    found = dict(_numbers(loop.controller, "controller"))
    if isinstance(loop.controller, SMC):
        # It is judged by its funnel but does not use it.
        found = {k: v for k, v in found.items() if ".funnel." not in k}
    found.update(_numbers(loop.observer, "observer"))
    guidance = getattr(loop.scenario.reference, _GUIDANCE.rpartition(".")[2], None)
    found.update(_numbers(guidance, _GUIDANCE))
    return found


def _numbers(module: Any, path: str) -> Iterator[tuple[str, tuple[Any, str]]]:
    if not isinstance(module, eqx.Module):
        return
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if field.name in _LEFT_OUT or field.metadata.get("static", False):
            continue
        below = f"{path}.{field.name}"
        if isinstance(value, eqx.Module):
            yield from _numbers(value, below)
        elif (
            isinstance(value, jax.Array)
            and value.shape == ()
            and jnp.issubdtype(value.dtype, jnp.floating)
        ):
            yield below, (module, field.name)


def leaves(loop: ClosedLoop, paths: Sequence[str]) -> list[Any]:
    """The arrays at whole paths."""
    return [attrgetter(path)(loop) for path in paths]


def _unknown(given: str, known: list[str]) -> str:
    groups = {".".join(path.split(".")[:n]) for path in known for n in range(1, 6)}
    near = difflib.get_close_matches(given, sorted(groups), 3)
    if near:
        return (
            f"{given!r} names nothing to tune in this closed loop; did you mean "
            f"{' or '.join(near)}? Below {', '.join(_heads(known))} there are "
            f"{len(known)} numbers."
        )
    return (
        f"{given!r} names nothing to tune in this closed loop; "
        f"choose from {', '.join(known)}."
    )


def _heads(known: list[str]) -> list[str]:
    return sorted({".".join(path.split(".")[:2]) for path in known})
