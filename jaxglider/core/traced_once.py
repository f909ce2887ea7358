"""Functions that are traced once, however often JAX transforms what calls them.

The body of a loop over time is a few thousand operations. JAX walks through all of them
for every transformation of the loop, again for each guess which of the loop's values
are batched or differentiated, and again for every program: some ten walks for a batch
of gradients, each a good part of a second. Here the body is one operation of the loop.
What it becomes under `vmap`, in the derivative and in the transposed derivative is
derived from it when asked for, and kept: one walk each, shared by all programs.

A derivative recomputes the function from its inputs, as `jax.checkpoint` does: nothing
inside is stored.
"""

import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jax.interpreters.partial_eval import dce_jaxpr, dce_rules

F = TypeVar("F", bound=Callable[..., Any])
Flags = tuple[bool, ...]
KEPT = 64
"""Functions, each with its inputs' types, whose traces are kept."""


def traced_once(function: F) -> F:
    """A pure function of pytrees of arrays that is one operation to JAX.

    Traced anew for other structures, shapes or precisions of its inputs, as a function
    under `jax.jit` is; the last `KEPT` of these are kept.

    Args:
        function: function whose result depends on its arguments alone.
    """

    def trace(structure: Any, leaves: Sequence[Any]) -> tuple["_Body", Any]:
        def flat(*leaves: Any) -> Any:
            return function(*jax.tree.unflatten(structure, leaves))

        closed, result = jax.make_jaxpr(flat, return_shape=True)(*leaves)
        types = closed.out_avals
        return _Body(types, lambda: closed), jax.tree.structure(result)

    kept: dict[Any, tuple[_Body, Any]] = {}

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        key = structure, tuple(jax.typeof(x) for x in leaves), jax.default_backend()
        with _ONE_AT_A_TIME:
            try:
                found = kept.pop(key, None)
            except (TypeError, ValueError):  # static fields that cannot be compared
                body, result = trace(structure, leaves)
            else:
                body, result = kept[key] = found or trace(structure, leaves)
                if len(kept) > KEPT:
                    del kept[next(iter(kept))]
        return jax.tree.unflatten(result, _call.bind(*leaves, body=body))

    return cast(F, call)


# Two threads that want the same trace: the second one waits for the first.
_ONE_AT_A_TIME = threading.RLock()


class _Body:
    """A function that is traced when it is needed, and what has been made of it.

    Attributes:
        types: types of its results.
    """

    def __init__(self, types: Sequence[Any], trace: Callable[[], ClosedJaxpr]) -> None:
        self.types = types
        self._trace = trace
        self._derived: dict[Any, _Body] = {}
        self._closed: ClosedJaxpr | None = None
        self._compiled: Callable[..., Any] | None = None

    @property
    def closed(self) -> ClosedJaxpr:
        """The trace, without what no result depends on."""
        # No cached_property: it has a lock of its own, and two locks in two orders stop
        # two threads for ever.
        with _ONE_AT_A_TIME:
            if self._closed is None:
                whole = self._trace()
                jaxpr, _ = dce_jaxpr(whole.jaxpr, [True] * len(self.types), True)
                self._closed = ClosedJaxpr(jaxpr, whole.consts)
            return self._closed

    @property
    def jaxpr(self) -> Any:
        """The operations, where those who walk through programs look for them."""
        return self.closed.jaxpr

    @property
    def compiled(self) -> Callable[..., Any]:
        """The function outside of any program of JAX."""
        with _ONE_AT_A_TIME:
            if self._compiled is None:
                self._compiled = jax.jit(jaxpr_as_fun(self.closed))
            return self._compiled

    def run(self, *inputs: Any) -> Any:
        """The function itself."""
        return jaxpr_as_fun(self.closed)(*inputs)

    def depends(self, inputs: Sequence[bool]) -> Flags:
        """Which results depend on any of the flagged inputs."""
        jaxpr = self.jaxpr
        reached = {x for x, flag in zip(jaxpr.invars, inputs, strict=True) if flag}

        def is_reached(x: Any) -> bool:
            return not isinstance(x, Literal) and x in reached

        for equation in jaxpr.eqns:
            if any(is_reached(x) for x in equation.invars):
                reached.update(equation.outvars)
        return tuple(is_reached(x) for x in jaxpr.outvars)

    def derived(
        self,
        key: Any,
        function: Callable[..., Any],
        inputs: Sequence[Any],
        types: Sequence[Any],
    ) -> "_Body":
        """A function of this one, for inputs like these; its trace waits."""
        kinds = [_placeholder(jax.typeof(x)) for x in inputs]
        return self.derived_from(key, types, lambda: jax.make_jaxpr(function)(*kinds))

    def derived_from(
        self, key: Any, types: Sequence[Any], trace: Callable[[], ClosedJaxpr]
    ) -> "_Body":
        """A function of this one by its trace."""
        return self._derived.setdefault(key, _Body(types, trace))


def _is_smooth(kind: Any) -> bool:
    return bool(jnp.issubdtype(kind.dtype, jnp.inexact))


def _placeholder(kind: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(kind.shape, kind.dtype, weak_type=kind.weak_type)


_call = Primitive("traced_once")
_call.multiple_results = True


@_call.def_impl
def _run(*inputs: Any, body: _Body) -> Any:
    return body.compiled(*inputs)


@_call.def_abstract_eval
def _types(*inputs: Any, body: _Body) -> Any:
    return body.types


def _lower(context: Any, *inputs: Any, body: _Body) -> Any:
    name, closed = _call.name, body.closed
    return mlir.core_call_lowering(context, *inputs, name=name, call_jaxpr=closed)


mlir.register_lowering(_call, _lower)


def _batched(inputs: Sequence[Any], axes: Sequence[Any], *, body: _Body) -> Any:
    """All lanes: of the results, those alone that differ between lanes get an axis."""
    flags = tuple(axis is not None for axis in axes)
    lanes = next(
        x.shape[axis] for x, axis in zip(inputs, axes, strict=True) if axis is not None
    )
    front = [
        x if axis in (None, 0) else jnp.moveaxis(x, axis, 0)
        for x, axis in zip(inputs, axes, strict=True)
    ]
    results = body.depends(flags)
    types = [
        kind.update(shape=(lanes, *kind.shape)) if flag else kind
        for kind, flag in zip(body.types, results, strict=True)
    ]
    ways, back = ([0 if flag else None for flag in on] for on in (flags, results))
    lane = jax.vmap(body.run, in_axes=tuple(ways), out_axes=back, axis_size=lanes)
    many = body.derived(("lanes", lanes, flags), lane, front, types)
    return _call.bind(*front, body=many), back


batching.primitive_batchers[_call] = _batched


def _jvp(
    primals: Sequence[Any], tangents: Sequence[Any], *, body: _Body
) -> tuple[Any, Any]:
    """The results, and an operation that is linear in the tangents."""
    moving = tuple(
        not isinstance(dot, ad.Zero) and _is_smooth(jax.typeof(x))
        for x, dot in zip(primals, tangents, strict=True)
    )
    results = _call.bind(*primals, body=body)
    types = body.types
    moved = tuple(
        flag and _is_smooth(kind)
        for kind, flag in zip(types, body.depends(moving), strict=True)
    )
    dots: list[Any] = [ad.Zero(kind.to_tangent_aval()) for kind in types]
    if any(moved):

        def along(*inputs: Any) -> Any:
            at, given = inputs[: len(moving)], list(inputs[len(moving) :])
            free = [x for x, flag in zip(at, moving, strict=True) if flag]

            def of(*free: Any) -> Any:
                return _chosen(body.run(*_merged(at, free, moving)), moved)

            return jax.jvp(of, free, given)[1]

        inputs = [*primals, *_chosen(tangents, moving)]
        slope = body.derived(
            ("along", moving),
            along,
            inputs,
            [kind.to_tangent_aval() for kind in _chosen(types, moved)],
        )
        found = iter(_call.bind(*inputs, body=slope))
        dots = [
            next(found) if flag else zero
            for flag, zero in zip(moved, dots, strict=True)
        ]
    return results, dots


ad.primitive_jvps[_call] = _jvp


def _transpose(cotangents: Sequence[Any], *inputs: Any, body: _Body) -> Any:
    """The transpose, where the function is linear in the inputs that are undefined."""
    linear = tuple(ad.is_undefined_primal(x) for x in inputs)
    given = tuple(not isinstance(x, ad.Zero) for x in cotangents)
    fixed = [x for x in inputs if not ad.is_undefined_primal(x)]
    count = len(fixed)
    types = [x.aval for x in inputs if ad.is_undefined_primal(x)]
    places = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in types]

    def back(*known: Any) -> Any:
        at, dots = known[:count], list(known[count:])

        def forth(*free: Any) -> Any:
            every = _merged([None] * len(linear), free, linear)
            every = _merged(every, at, tuple(not flag for flag in linear))
            return _chosen(body.run(*every), given)

        return jax.linear_transpose(forth, *places)(dots)

    known = [*fixed, *_chosen(cotangents, given)]
    pulled = body.derived(("back", linear, given), back, known, types)
    found = iter(_call.bind(*known, body=pulled))
    return [next(found) if flag else None for flag in linear]


ad.primitive_transposes[_call] = _transpose


def _used(wanted: Sequence[bool], equation: JaxprEqn) -> tuple[list[bool], Any]:
    """The operation without results that nobody wants, and what only they need."""
    results = tuple(wanted)
    if not any(results):
        return [False] * len(equation.invars), None
    body = equation.params["body"]
    jaxpr, needs = dce_jaxpr(body.jaxpr, results, False)
    if all(results) and all(needs):
        return needs, equation
    kept = body.derived_from(
        ("used", results),
        _chosen(body.types, results),
        lambda: ClosedJaxpr(jaxpr, body.closed.consts),
    )
    return needs, equation.replace(
        invars=_chosen(equation.invars, needs),
        outvars=_chosen(equation.outvars, results),
        params={"body": kept},
    )


dce_rules[_call] = _used


def _chosen(values: Sequence[Any], flags: Sequence[bool]) -> list[Any]:
    return [x for x, flag in zip(values, flags, strict=True) if flag]


def _merged(values: Sequence[Any], others: Sequence[Any], flags: Flags) -> list[Any]:
    """The values, with the others in the flagged places."""
    other = iter(others)
    return [next(other) if flag else x for x, flag in zip(values, flags, strict=True)]
