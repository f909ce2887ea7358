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
    above = number >= low if closed_low else number > low
    below = number <= high if closed_high else number < high
    if not np.all(above & below):
        rule = _interval_words(low, high, closed_low, closed_high)
        hint = f" {remedy}" if remedy else ""
        raise ValueError(f"{owner}.{name} must be {rule}; received {number}.{hint}")


def _interval_words(
    low: float, high: float, closed_low: bool, closed_high: bool
) -> str:
    if np.isinf(high):
        if low == 0:
            return "zero or positive" if closed_low else "positive"
        return f"{'at least' if closed_low else 'above'} {low:g}"
    if np.isinf(low):
        return f"{'at most' if closed_high else 'below'} {high:g}"
    opening, closing = "[" if closed_low else "(", "]" if closed_high else ")"
    return f"in {opening}{low:g}, {high:g}{closing}"


class Container(eqx.Module):
    """Base of everything a user builds: refuses numbers that are not finite."""

    def __check_init__(self) -> None:
        for field in dataclasses.fields(self):
            check_finite(type(self).__name__, field.name, getattr(self, field.name))


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
