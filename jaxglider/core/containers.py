"""Array aliases, the one float converter, and the checks made when an object is built.

Every number that may be uncertain or tuned is a strongly typed scalar array: a weakly
typed one would be traced again as soon as it met a strongly typed one.
"""

import dataclasses
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxglider.core.sets import POSITIVE, Interval, NumberSet

if TYPE_CHECKING:
    # Fields take numbers and hold arrays; a type checker does not follow converters.
    Scalar = Any
    Series = Any
else:
    Scalar = Float[Array, ""]
    Series = Float[Array, " n"]
Flag = Bool[Array, ""]
Counter = Int[Array, ""]


def as_float(value: Any) -> Any:
    """Convert a number to a strongly typed array; anything else passes unchanged.

    Arrays that are already floating keep their precision, so a single-precision object
    stays one when double precision is enabled. Python and NumPy numbers take the
    default precision of JAX.

    Args:
        value: number, array or tracer of numbers, or any other object.

    Returns:
        A strongly typed floating array, or `value` itself where it is no number.
    """
    if isinstance(value, jax.Array):
        if jnp.issubdtype(value.dtype, jnp.integer):
            return value.astype(jnp.result_type(float))
        if jnp.issubdtype(value.dtype, jnp.floating) and value.aval.weak_type:
            return jax.lax.convert_element_type(value, np.dtype(value.dtype))
        return value
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, int | float | np.ndarray | np.number | list):
        return jnp.asarray(value, dtype=jnp.result_type(float))
    return value


def concrete(value: Any) -> np.ndarray | None:
    """The value as a NumPy array, or None where it is traced or no number."""
    if isinstance(value, jax.core.Tracer) or not eqx.is_array_like(value):
        return None
    array = np.asarray(value)
    return array if np.issubdtype(array.dtype, np.number) else None


def check_finite(owner: str, name: str, value: Any) -> None:
    """Refuse NaN and infinity.

    Args:
        owner: name of the class, for the message.
        name: name of the field.
        value: number or array; a traced one passes unchecked.

    Raises:
        ValueError: `value` is concrete and not finite.
    """
    number = concrete(value)
    if number is not None and not np.all(np.isfinite(number)):
        raise ValueError(
            f"{owner}.{name} must be finite; received {number}. "
            "Give a number in SI units."
        )


def check_interval(
    owner: str,
    name: str,
    value: Any,
    low: float = -np.inf,
    high: float = np.inf,
    *,
    closed_low: bool = False,
    closed_high: bool = False,
    remedy: str = "",
) -> None:
    """Refuse a concrete value outside an interval (open at both ends by default).

    Args:
        owner: name of the class, for the message.
        name: name of the field or argument.
        value: number or array; a traced one passes unchecked.
        low: lower end of the interval.
        high: upper end of the interval.
        closed_low: flag, the lower end belongs to the interval.
        closed_high: flag, the upper end belongs to the interval.
        remedy: advice added to the message.

    Raises:
        ValueError: `value` is concrete and outside.
    """
    number = concrete(value)
    if number is None:
        return
    interval = Interval(low, high, closed_low, closed_high)
    if not np.all(interval.holds(number)):
        hint = f" {remedy}" if remedy else ""
        raise ValueError(
            f"{owner}.{name} must be {interval.words()}; received {number}.{hint}"
        )


def check_set(owner: str, name: str, value: Any, numbers: NumberSet) -> None:
    """Refuse concrete numbers outside the set of their field.

    Args:
        owner: class that has the field.
        name: name of the field.
        value: number, container of numbers, or anything else, which passes.
        numbers: set of the field; of a coupled one, that they are positive.

    Raises:
        ValueError: names the number, the set and the value.
    """
    if isinstance(value, eqx.Module):
        for below, part in vars(value).items():
            check_set(owner, f"{name}.{below}", part, numbers)
        return
    interval = numbers if isinstance(numbers, Interval) else POSITIVE
    check_interval(owner, name, value, **dataclasses.asdict(interval))


class Container(eqx.Module):
    """Base of everything a user builds: refuses numbers that it cannot have.

    Raises:
        ValueError: a number is not finite, or outside the set of its field.
    """

    def __check_init__(self) -> None:
        owner = type(self).__name__
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            check_finite(owner, field.name, value)
            if "set" in field.metadata:
                check_set(owner, field.name, value, field.metadata["set"])


def choose(argument: str, value: str, allowed: tuple[str, ...]) -> None:
    """Refuse a name that is not one of those allowed.

    Args:
        argument: name of the argument, for the message.
        value: name that was given.
        allowed: choices.

    Raises:
        ValueError: names the argument and the choices.
    """
    if value not in allowed:
        raise ValueError(
            f"{argument} must be one of {', '.join(allowed)}; received {value!r}."
        )
