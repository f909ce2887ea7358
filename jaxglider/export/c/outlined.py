"""C functions of their own for parts of a trace, and the kinds of their scalars."""

import dataclasses
from functools import cache
from typing import Any

import jax
from jax.extend.core import ClosedJaxpr

from jaxglider.core import elementary
from jaxglider.export.c.block import C_TYPES, Block, ExportError, Number

ELEMENTARY = ("sincos", "log2", "exp2", "arctan")
"""Functions of `elementary` that work on the bits of a float or on its precision."""

_KINDS = {"float64": "real", "float32": "real"}


@dataclasses.dataclass
class Outlined:
    """A C function of scalars that writes its results to addresses.

    Attributes:
        name: name of the function.
        arguments: kinds of its arguments.
        results: numbers that it returns.
        block: statements of its body.
    """

    name: str
    arguments: list[str]
    results: list[Number]
    block: Block

    def signature(self) -> dict[str, str]:
        """Declarations of its arguments by their names, the results' left out."""
        return {
            f"a{n}": f"const {C_TYPES[k]} a{n}" for n, k in enumerate(self.arguments)
        }

    def addresses(self) -> list[str]:
        """Declarations of the addresses of its results."""
        return [f"{C_TYPES[r.kind]} *r{n}" for n, r in enumerate(self.results)]

    def stores(self) -> list[str]:
        """Statements that write the results."""
        return [f"*r{n} = {r.text};" for n, r in enumerate(self.results)]


@dataclasses.dataclass
class Functions:
    """Functions that all functions of one file share.

    Attributes:
        outlined: functions for either precision, by the text of their trace.
        elementary: functions for double precision and for single precision.
    """

    outlined: dict[str, Outlined] = dataclasses.field(default_factory=dict)
    elementary: dict[str, tuple[Outlined, Outlined]] = dataclasses.field(
        default_factory=dict
    )


def kind_of(dtype: Any) -> str:
    """The kind of scalar that a dtype of JAX is in C.

    Raises:
        ExportError: there is none.
    """
    name = str(dtype)
    kind = _KINDS.get(name, name)
    if kind not in C_TYPES:
        raise ExportError(f"numbers of type {name} cannot be exported.")
    return kind


def opened(closed: Any) -> Any:
    """A trace without its constants; newer versions of JAX have one class for both."""
    return getattr(closed, "jaxpr", closed)


@cache
def trace(name: str, dtype: str, shape: tuple[int, ...] = ()) -> ClosedJaxpr:
    """The trace of one elementary function, without the call around it.

    Args:
        name: name of the function in `elementary`.
        dtype: type of its argument.
        shape: shape of its argument.
    """
    function = getattr(elementary, name)
    for _ in shape:
        function = jax.vmap(function)
    closed = jax.make_jaxpr(function)(jax.ShapeDtypeStruct(shape, dtype))
    (equation,) = closed.jaxpr.eqns
    return equation.params["call_jaxpr"]


def trace_text(name: str, shape: tuple[int, ...]) -> str:
    """By which a call of an elementary function in double precision is known."""
    return str(trace(name, "float64", shape))
