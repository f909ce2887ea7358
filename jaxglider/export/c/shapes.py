"""Primitives that move or join scalars: small arrays, written out number by number.

An array is a NumPy array of `Number`; moving its elements about costs nothing in C.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxglider.export.c.block import Block, ExportError, Number, literal
from jaxglider.export.c.operations import apply, unsupported
from jaxglider.export.c.outlined import opened

Array = Any
"""A NumPy array of `Number`."""


MANY_TERMS = 500
"""Products of matrices with more terms than this are left to a function."""


def whole(numbers: Sequence[Number], shape: tuple[int, ...]) -> Array:
    """Numbers in an array of a shape."""
    array = np.empty(len(numbers), dtype=object)
    array[:] = numbers
    return array.reshape(shape)


def constant(value: Any, kind: str) -> Array:
    """An array that is known now."""
    array = np.asarray(value)
    return whole([literal(x, kind) for x in array.ravel()], array.shape)


def _broadcast(x: Array, shape: Sequence[int], dimensions: Sequence[int]) -> Array:
    expanded = [1] * len(shape)
    for axis, size in zip(dimensions, x.shape, strict=True):
        expanded[axis] = size
    return np.broadcast_to(x.reshape(expanded), tuple(shape))


def _slice(x: Array, params: dict[str, Any]) -> Array:
    strides = params["strides"] or (1,) * x.ndim
    bounds = zip(params["start_indices"], params["limit_indices"], strides, strict=True)
    return x[tuple(slice(*b) for b in bounds)]


def rearranged(
    name: str, x: Sequence[Array], shape: tuple[int, ...], params: dict[str, Any]
) -> Array | None:
    """The result of a primitive that only moves numbers, or None for any other.

    Args:
        name: name of the primitive.
        x: operands of the primitive.
        shape: shape of its result.
        params: parameters of the primitive.
    """
    if name in ("reshape", "squeeze", "expand_dims"):
        return x[0].reshape(shape)
    if name == "broadcast_in_dim":
        return _broadcast(x[0], params["shape"], params["broadcast_dimensions"])
    if name == "slice":
        return _slice(x[0], params)
    if name == "concatenate":
        return np.concatenate(x, axis=params["dimension"])
    if name == "stack":
        return np.stack(x, axis=params["axis"])
    if name == "transpose":
        return np.transpose(x[0], params["permutation"])
    if name == "rev":
        return np.flip(x[0], params["dimensions"])
    return None


def fold(block: Block, name: str, x: Array, axes: Sequence[int], kind: str) -> Array:
    """A reduction over axes, from the first number to the last.

    Args:
        block: block that takes the statements.
        name: name of the primitive that joins two numbers.
        x: operand.
        axes: axes to reduce.
        kind: kind of the result.
    """
    rest = [n for n in range(x.ndim) if n not in axes]
    rows = np.transpose(x, [*rest, *axes]).reshape([*(x.shape[n] for n in rest), -1])
    result = np.empty(rows.shape[:-1], dtype=object)
    for index in np.ndindex(*result.shape):
        first, *others = rows[index]
        for other in others:
            first = apply(block, name, (first, other), kind, {})
        result[index] = first
    return result


def running(
    block: Block, name: str, x: Array, axis: int, reverse: bool, kind: str
) -> Array:
    """A running sum, product, minimum or maximum along one axis.

    Args:
        block: block that takes the statements.
        name: name of the primitive that joins two numbers.
        x: operand.
        axis: axis to run along.
        reverse: flag, from the last number to the first.
        kind: kind of the result.
    """
    result = np.moveaxis(np.flip(x, axis) if reverse else x, axis, 0).copy()
    for n in range(1, len(result)):
        for index in np.ndindex(*result.shape[1:]):
            pair = (result[(n - 1, *index)], result[(n, *index)])
            result[(n, *index)] = apply(block, name, pair, kind, {})
    result = np.moveaxis(result, 0, axis)
    return np.flip(result, axis) if reverse else result


def dot(block: Block, x: Sequence[Array], dimensions: Any, kind: str) -> Array:
    """A product of small matrices or vectors, without batch dimensions.

    Args:
        block: block that takes the statements.
        x: operands, left and right.
        dimensions: `dimension_numbers` of the primitive.
        kind: kind of the result.

    Raises:
        ExportError: there are batch dimensions, or there is no contraction.
    """
    (left, right), batch = dimensions
    if any(batch):
        raise ExportError(unsupported("dot_general", " with batch dimensions"))
    if not left:
        raise ExportError(unsupported("dot_general", " without a contraction"))
    a = np.moveaxis(x[0], left, range(len(left)))
    b = np.moveaxis(x[1], right, range(len(right)))
    size = int(np.prod(a.shape[: len(left)]))
    a = a.reshape(size, *a.shape[len(left) :])
    b = b.reshape(size, *b.shape[len(right) :])
    shape = a.shape[1:] + b.shape[1:]
    if a.size * int(np.prod(b.shape[1:], dtype=int)) > MANY_TERMS and kind == "real":
        return _product(block, a, b).reshape(shape)
    result = np.empty(shape, dtype=object)
    for at in np.ndindex(*a.shape[1:]):
        for to in np.ndindex(*b.shape[1:]):
            terms = [
                apply(block, "mul", (a[(n, *at)], b[(n, *to)]), kind, {})
                for n in range(size)
            ]
            result[at + to] = fold(block, "add", whole(terms, (size,)), (0,), kind)[()]
    return result


def _product(block: Block, a: Array, b: Array) -> Array:
    """Σ a_ni b_nj by a function of the header, the first axis being n."""
    size, rows, columns = len(a), a.size // len(a), b.size // len(b)
    tables = [block.table("real", list(x.ravel())) for x in (a, b)]
    name = f"v{len(block.statements)}"
    places = [f"{name}[{k}]" for k in range(rows * columns)]
    given = ", ".join([*(t.text for t in tables), name])
    block.loop(
        [(place, "real") for place in places],
        f"glider_real {name}[{len(places)}]; "
        f"real_product({given}, {size}, {rows}, {columns});",
        tables,
        f"product {size * rows * columns}",
    )
    return whole([Number("real", place, True) for place in places], (rows * columns,))


def parts_of_scan(equation: Any) -> tuple[int, int]:
    """Numbers of the constants that a scan takes and of the values it carries.

    By the shapes, which no version of JAX names differently: what is scanned over, or
    stacked, has an axis more outside the body than inside.
    """
    body = opened(equation.params["jaxpr"])

    def as_inside(outer: Sequence[Any], inner: Sequence[Any]) -> int:
        return sum(
            len(a.aval.shape) == len(b.aval.shape)
            for a, b in zip(outer, inner, strict=True)
        )

    carried = as_inside(equation.outvars, body.outvars)
    return as_inside(equation.invars, body.invars) - carried, carried
