"""Arguments from Python: each is refused by its own name, with the rule."""

import operator
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.uncertainty.members import Uncertainty
from tuning.problem.aggregates import AbstractAggregate, make_aggregate
from tuning.problem.objective import Weights
from tuning.problem.objective_file import read_objective


def refuse(name: str, rule: str, value: Any) -> ValueError:
    """The error of an argument.

    Args:
        name: name of the argument.
        rule: description of what it must be.
        value: value received.
    """
    return ValueError(f"{name} must be {rule}; received {value!r}.")


def whole(name: str, value: Any, least: int = 1, below: int | None = None) -> int:
    """A whole number in [least, below).

    Args:
        name: name of the argument.
        value: value received.
        least: least number allowed.
        below: number that it must be below; None for any.

    Raises:
        ValueError: it is none.
    """
    rule = f"a whole number of at least {least}"
    if below is not None:
        rule = f"a whole number in [{least}, {below})"
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least or (below is not None and number >= below):
        raise refuse(name, rule, value)
    return number


def real(name: str, value: Any, low: float, high: float, rule: str) -> float:
    """A number between two others, neither of them included.

    Args:
        name: name of the argument.
        value: value received.
        low: number that it must be above.
        high: number that it must be below.
        rule: description of what it must be.

    Raises:
        ValueError: it is none.
    """
    try:
        number = None if isinstance(value, str | bool) else float(value)
    except (TypeError, ValueError):
        number = None
    if number is None or not low < number < high:
        raise refuse(name, rule, value)
    return number


def half_width(value: Any, *, zero: bool) -> Uncertainty | float:
    """An uncertainty, or a relative half width.

    Args:
        value: value of the argument `uncertainty`.
        zero: whether the half width may be zero, for the nominal case alone.

    Raises:
        ValueError: it is neither.
    """
    if isinstance(value, Uncertainty):
        return value
    rule = f"a number in {'[' if zero else '('}0, 1) or an Uncertainty"
    low = -5e-324 if zero else 0.0
    return real("uncertainty", value, low, 1.0, rule)


def closed_loop(name: str, value: Any) -> ClosedLoop:
    """A closed loop.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, ClosedLoop):
        raise refuse(name, "a ClosedLoop", value)
    return value


def closed_loops(value: Any) -> dict[str, ClosedLoop]:
    """Closed loops by name; one alone is called `loop`.

    Raises:
        ValueError: it is neither a closed loop nor a mapping of text to closed loops.
    """
    if isinstance(value, ClosedLoop):
        return {"loop": value}
    if not isinstance(value, Mapping):
        raise refuse("loops", "a ClosedLoop or ClosedLoops by name", value)
    for name, loop in value.items():
        if not isinstance(name, str):
            raise refuse("each name in loops", "text", name)
        closed_loop(f"loops[{name!r}]", loop)
    return dict(value)


def texts(name: str, value: Any) -> tuple[str, ...]:
    """Several texts; one alone counts as one.

    Raises:
        ValueError: it is neither.
    """
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, Sequence) or not all(isinstance(x, str) for x in value):
        raise refuse(name, "a sequence of texts", value)
    return tuple(value)


def instance(name: str, value: Any, kind: type, hint: str = "") -> None:
    """Refuse what is neither None nor of a kind.

    Args:
        name: name of the argument.
        value: value received.
        kind: class that it must be of.
        hint: example of one, for the message.

    Raises:
        ValueError: it is another thing.
    """
    if value is not None and not isinstance(value, kind):
        raise refuse(name, f"a {kind.__name__}{hint} or None", value)


def objective_of(
    objective: Any, aggregate: Any = None
) -> tuple[Weights, AbstractAggregate]:
    """Weights and aggregate of the arguments `objective` and `aggregate`.

    Args:
        objective: weights, or the path of an objective file.
        aggregate: aggregate, or its name; that of the file, else the mean, where None.

    Raises:
        ValueError: one of them cannot be used.
    """
    named = aggregate if isinstance(aggregate, str) else None
    if not isinstance(aggregate, str | AbstractAggregate | None):
        rule = "mean, cvar, worst or an AbstractAggregate"
        raise refuse("aggregate", rule, aggregate)
    if isinstance(objective, Weights):
        weights, its_own = objective, make_aggregate(named or "mean")
    elif isinstance(objective, str | Path):
        if not Path(objective).is_file():
            rule = "Weights or the path of an objective file"
            place = f"{str(objective)!r}, and {Path(objective).absolute()} is no file"
            raise ValueError(f"objective must be {rule}; received {place}.")
        weights, its_own = read_objective(Path(objective), named)
    else:
        raise refuse("objective", "Weights or the path of an objective file", objective)
    return weights, aggregate if isinstance(aggregate, AbstractAggregate) else its_own
