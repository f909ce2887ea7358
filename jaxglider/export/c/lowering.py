"""From the trace of a pure function, its jaxpr, to the statements of a C function.

The trace is what JAX itself compiles, so the C code cannot drift from it: any
controller that can be simulated is written out the same way. Covered are the
elementwise primitives of `operations`, the rearrangements of `shapes`, what `indexing`
takes and puts, nested calls, `cond`, and the `loops` of `scan`; anything else is
refused by name.

Calls that come again and again become functions of their own. The elementary functions
of `elementary` depend on the floating format and are written for both.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Literal

from jaxglider.export.c.block import Block, ExportError, Number
from jaxglider.export.c.indexing import dynamic_slice, gather, pad, scatter
from jaxglider.export.c.loops import scan
from jaxglider.export.c.operations import apply, covered, unsupported
from jaxglider.export.c.outlined import (
    ELEMENTARY,
    Functions,
    Outlined,
    kind_of,
    opened,
    trace,
    trace_text,
)
from jaxglider.export.c.shapes import (
    Array,
    constant,
    dot,
    fold,
    rearranged,
    running,
    whole,
)

WORTH_A_FUNCTION = 12
"""Calls with fewer equations than this are written in line."""

_REDUCTIONS = {
    "reduce_sum": "add",
    "reduce_prod": "mul",
    "reduce_max": "max",
    "reduce_min": "min",
    "reduce_and": "and",
    "reduce_or": "or",
}
_RUNNING = {"cumsum": "add", "cumprod": "mul", "cummax": "max", "cummin": "min"}
_CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}


class Lowering:
    """Evaluates a jaxpr on scalars of C."""

    def __init__(self, block: Block, functions: Functions) -> None:
        self.block, self.functions = block, functions

    def within(self, block: Block) -> "Lowering":
        """The same for another function of the file."""
        return Lowering(block, self.functions)

    def closed(self, closed: Any, arguments: Sequence[Array]) -> list[Array]:
        """The results of a jaxpr with its constants."""
        return self.evaluate(opened(closed), getattr(closed, "consts", ()), arguments)

    def evaluate(
        self, jaxpr: Any, constants: Sequence[Any], arguments: Sequence[Array]
    ) -> list[Array]:
        """The results of a jaxpr.

        Args:
            jaxpr: the trace.
            constants: values of its constant variables.
            arguments: values of its arguments.

        Raises:
            ExportError: names a primitive that is not covered.
        """
        known: dict[Any, Array] = {}

        def read(variable: Any) -> Array:
            aval: Any = variable.aval
            if isinstance(variable, Literal):
                return constant(variable.val, kind_of(aval.dtype))
            return known[variable]

        for variable, value in zip(jaxpr.constvars, constants, strict=True):
            known[variable] = constant(value, kind_of(variable.aval.dtype))
        known.update(zip(jaxpr.invars, arguments, strict=True))
        for equation in jaxpr.eqns:
            results = self._equation(equation, [read(v) for v in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def _equation(self, equation: Any, x: list[Array]) -> Sequence[Array]:
        name, params = equation.primitive.name, equation.params
        if name in _CALLS:
            return self._call(params[_CALLS[name]], x)
        if name == "cond":
            return self._cond(params["branches"], x)
        if name == "scan":
            return scan(self, equation, x)
        if name == "optimization_barrier":
            return x
        if name == "unstack":
            parts = range(len(equation.outvars))
            return [np.take(x[0], n, axis=params["axis"]) for n in parts]
        if name == "split":
            ends = np.cumsum(params["sizes"])[:-1]
            return np.split(x[0], ends, axis=params["axis"])
        if all(n.value is not None for a in x for n in a.ravel()):
            return self._folded(equation, x)
        shape = tuple(equation.outvars[0].aval.shape)
        kind = kind_of(equation.outvars[0].aval.dtype)
        moved = rearranged(name, x, shape, params)
        if moved is None:
            moved = self._collective(name, x, shape, params, kind)
        if moved is None:
            moved = self._elementwise(name, x, shape, params, kind)
        return [moved]

    def _folded(self, equation: Any, x: list[Array]) -> list[Array]:
        """The result of a primitive of known numbers, computed by JAX."""
        values = [
            jnp.asarray(
                np.array([n.value for n in a.ravel()]).reshape(a.shape), v.aval.dtype
            )
            for a, v in zip(x, equation.invars, strict=True)
        ]
        results = equation.primitive.bind(*values, **equation.params)
        if not equation.primitive.multiple_results:
            results = [results]
        return [
            constant(r, kind_of(v.aval.dtype))
            for r, v in zip(results, equation.outvars, strict=True)
        ]

    def _collective(
        self, name: str, x: list[Array], shape: tuple[int, ...], params: Any, kind: str
    ) -> Array | None:
        block = self.block
        if name in _REDUCTIONS:
            return fold(block, _REDUCTIONS[name], x[0], params["axes"], kind)
        if name in _RUNNING:
            axis, reverse = params["axis"], params["reverse"]
            return running(block, _RUNNING[name], x[0], axis, reverse, kind)
        if name == "dot_general":
            return dot(block, x, params["dimension_numbers"], kind)
        if name == "gather":
            return gather(block, x, shape, params)
        if name == "pad":
            return pad(x, params["padding_config"])
        if name in ("scatter", "scatter-add"):
            return scatter(block, name, x, params)
        if name == "dynamic_slice":
            return dynamic_slice(block, x, params["slice_sizes"])
        return None

    def _elementwise(
        self, name: str, x: list[Array], shape: tuple[int, ...], params: Any, kind: str
    ) -> Array:
        if name not in covered():
            raise ExportError(unsupported(name))
        columns = [np.broadcast_to(a, shape).ravel() for a in x]
        rows = zip(*columns, strict=True)
        numbers = [apply(self.block, name, row, kind, params) for row in rows]
        return whole(numbers, shape)

    def _cond(self, branches: Sequence[Any], x: list[Array]) -> list[Array]:
        """All branches are computed, and one is taken."""
        which, *operands = x
        results = [self.closed(branch, operands) for branch in branches]
        selections = []
        for cases in zip(*results, strict=True):
            rows = zip(*(c.ravel() for c in cases), strict=True)
            numbers = [
                apply(self.block, "select_n", (which[()], *row), row[0].kind, {})
                for row in rows
            ]
            selections.append(whole(numbers, cases[0].shape))
        return selections

    def _call(self, closed: Any, x: list[Array]) -> Sequence[Array]:
        inner = opened(closed)
        name, text = inner.debug_info.func_name, str(closed)
        shape = tuple(x[0].shape) if x else ()
        if name in ELEMENTARY and text == trace_text(name, shape):
            return self._elementary(name, x[0])
        if (
            not self.block.of_one_precision
            and not inner.constvars
            and len(inner.eqns) >= WORTH_A_FUNCTION
            and all(not v.aval.shape for v in (*inner.invars, *inner.outvars))
            and any(n.value is None for a in x for n in a.ravel())
        ):
            return self._called(self._outline(text, closed), [a[()] for a in x])
        return self.closed(closed, x)

    def _outline(self, text: str, closed: ClosedJaxpr) -> Outlined:
        known = self.functions.outlined
        if text not in known:
            stem = opened(closed).debug_info.func_name.strip("<>_") or "part"
            function = outlined(stem, closed, self.functions)
            # Numbered only now: functions that it calls come before it.
            function.name = f"{stem}_{len(known) + 1}"
            known[text] = function
        return known[text]

    def _elementary(self, name: str, x: Array) -> list[Array]:
        """An elementary function, number by number."""
        known = self.functions.elementary
        if name not in known:
            double, single = (
                outlined(f"elementary_{name}", trace(name, dtype), None)
                for dtype in ("float64", "float32")
            )
            known[name] = double, single
        columns = [self._called(known[name][0], [n]) for n in x.ravel()]
        return [
            whole([r[()] for r in results], x.shape)
            for results in zip(*columns, strict=True)
        ]

    def _called(self, function: Outlined, arguments: list[Number]) -> list[Array]:
        kinds = [r.kind for r in function.results]
        results = self.block.call(function.name, kinds, arguments)
        return [whole([r], ()) for r in results]


def outlined(name: str, closed: ClosedJaxpr, functions: Functions | None) -> Outlined:
    """A function of its own for a jaxpr of scalars.

    Args:
        name: name of the function.
        closed: trace of the function.
        functions: functions of the file; None for a function of one precision, which
            calls no other.
    """
    block = Block(of_one_precision=functions is None)
    kinds = [kind_of(v.aval.dtype) for v in opened(closed).invars]
    arguments = [whole([Number(k, f"a{n}", True)], ()) for n, k in enumerate(kinds)]
    lowering = Lowering(block, functions or Functions())
    results = lowering.closed(closed, arguments)
    return Outlined(
        name=name, arguments=kinds, results=[r[()] for r in results], block=block
    )


def lower(
    block: Block,
    function: Callable[..., Any],
    arguments: Sequence[Any],
    numbers: Sequence[Array],
    functions: Functions,
) -> list[Array]:
    """Write the statements of a function of pytrees.

    Args:
        block: block that takes the statements.
        function: pure and traceable function.
        arguments: examples of what it takes.
        numbers: scalars in C for each leaf of the arguments.
        functions: functions of the file, shared with its other functions.

    Returns:
        For each leaf of the result its scalars.

    Raises:
        ExportError: names a primitive that is not covered.
    """
    closed = jax.make_jaxpr(function)(*arguments)
    return Lowering(block, functions).closed(closed, numbers)
