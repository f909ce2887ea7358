"""Primitives that move or gather scalars: small arrays, written out number by number.

An array is a NumPy array of `Number`; moving its elements about costs nothing in C. An
index that is only known on board becomes a chain of selections, or, where there is much
to choose from, one into a table.
"""

import itertools
import re
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider.export.c.block import Block, ExportError, Number, literal
from jaxglider.export.c.operations import apply, unsupported
from jaxglider.export.c.outlined import opened

Array = Any
"""A NumPy array of `Number`."""

FEW = 8
"""Places among which one index chooses by selections; among more, from a table."""

MAX_CHOICES = 1024
"""Longest chain of selections for several indices."""


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
    result = np.empty(a.shape[1:] + b.shape[1:], dtype=object)
    for at in np.ndindex(*a.shape[1:]):
        for to in np.ndindex(*b.shape[1:]):
            terms = [
                apply(block, "mul", (a[(n, *at)], b[(n, *to)]), kind, {})
                for n in range(size)
            ]
            result[at + to] = fold(block, "add", whole(terms, (size,)), (0,), kind)[()]
    return result


def gather(
    block: Block, x: Sequence[Array], shape: tuple[int, ...], params: dict[str, Any]
) -> Array:
    """x[index] for one index vector: for each place it can point at, a selection.

    Args:
        block: block that takes the statements.
        x: operand and index.
        shape: shape of the result.
        params: parameters of the primitive.

    Raises:
        ExportError: the index points at several places at once, or at too many.
    """
    operand, indices = x
    if indices.size != indices.shape[-1]:
        raise ExportError(unsupported("gather", " at several places at once"))
    sizes, mode = params["slice_sizes"], str(params["mode"]).rsplit(".", 1)[-1]
    axes = params["dimension_numbers"].start_index_map
    numbering = jnp.arange(operand.size).reshape(operand.shape)
    parts = list(indices.ravel())
    settings = {k: v for k, v in params.items() if k not in ("mode", "fill_value")}

    def slice_at(at: Sequence[int]) -> Array:
        place = jnp.asarray(at).reshape(indices.shape)
        chosen = lax.gather_p.bind(
            numbering, place, mode=params["mode"], fill_value=-1, **settings
        )
        return whole(list(operand.ravel()[np.ravel(chosen)]), shape)

    ranges = [operand.shape[n] - sizes[n] + 1 for n in axes]
    result = choose(block, parts, ranges, slice_at)
    if "FILL" not in mode:
        return result
    for index, size in zip(parts, ranges, strict=True):
        low = apply(block, "lt", (index, literal(0, index.kind)), "bool", {})
        high = apply(block, "ge", (index, literal(size, index.kind)), "bool", {})
        outside = apply(block, "or", (low, high), "bool", {})
        for place in np.ndindex(*shape):
            old = result[place]
            missing = literal(np.nan if old.kind == "real" else 0, old.kind)
            result[place] = apply(
                block, "select_n", (outside, old, missing), old.kind, {}
            )
    return result


def dynamic_slice(block: Block, x: Sequence[Array], sizes: Sequence[int]) -> Array:
    """A window of an array at a place known on board, pushed inside.

    Args:
        block: block that takes the statements.
        x: operand and the start along each axis.
        sizes: size of the window along each axis.
    """
    operand, *starts = x
    ranges = [n - s + 1 for n, s in zip(operand.shape, sizes, strict=True)]

    def slice_at(at: Sequence[int]) -> Array:
        return operand[tuple(slice(a, a + s) for a, s in zip(at, sizes, strict=True))]

    return choose(block, [s[()] for s in starts], ranges, slice_at)


def choose(
    block: Block,
    index: Sequence[Number],
    ranges: Sequence[int],
    slice_at: Callable[[Sequence[int]], Array],
) -> Array:
    """slice_at(index) for an index known on board, each part clamped to its range.

    Args:
        block: block that takes the statements.
        index: parts of the index.
        ranges: number of places that each part can point at.
        slice_at: function from an index to the numbers there.

    Raises:
        ExportError: there are too many places.
    """
    places = list(itertools.product(*(range(n) for n in ranges)))
    many = [at for at, n in enumerate(ranges) if n > 1]
    in_table = len(many) == 1 and len(places) > FEW
    if len(places) > MAX_CHOICES and not in_table:
        raise ExportError(
            f"an index with {len(places)} places to point at cannot be exported; "
            f"at most {MAX_CHOICES}. Use a shorter table."
        )
    if all(i.value is not None for i in index):
        known = [
            min(max(int(i.value), 0), n - 1) for i, n in zip(index, ranges, strict=True)
        ]
        return np.array(slice_at(known), dtype=object)
    if in_table:
        columns = [slice_at(place) for place in places]
        return whole(
            [
                looked_up(block, index[many[0]], [column[n] for column in columns])
                for n in np.ndindex(*columns[0].shape)
            ],
            columns[0].shape,
        )
    result: Any = np.array(slice_at(places[-1]), dtype=object)
    for place in reversed(places[:-1]):
        here = _points_at(block, index, ranges, place)
        for n in np.ndindex(*result.shape):
            pair = (here, result[n], slice_at(place)[n])
            result[n] = apply(block, "select_n", pair, pair[1].kind, {})
    return result


def looked_up(block: Block, index: Number, values: Sequence[Number]) -> Number:
    """values[index], the index clamped to its range: from the array that holds them.

    Numbers that stand side by side in a structure are its table already.

    Args:
        block: block that takes the statements.
        index: index, known on board.
        values: numbers to choose from.
    """
    kind = values[0].kind
    if all(v.text == values[0].text for v in values):
        return values[0]
    last = literal(len(values) - 1, index.kind)
    raised = apply(block, "max", (index, literal(0, index.kind)), index.kind, {})
    at = apply(block, "min", (raised, last), index.kind, {})
    places = [re.fullmatch(r"(.*)\[(\d+)\]", v.text) for v in values]
    stems = {place[1] for place in places if place}
    numbers = [int(place[2]) for place in places if place]
    if len(stems) == 1 and numbers == list(range(len(values))):
        text = f"{stems.pop()}[{at.text}]"
        return block.compute(kind, text, (at, *values), "look_up")
    table = block.table(kind, values)
    return block.compute(kind, f"{table.text}[{at.text}]", (at, table), "look_up")


def _points_at(
    block: Block, index: Sequence[Number], ranges: Sequence[int], place: Sequence[int]
) -> Number:
    """Whether an index means a place: below the range its first, above it its last."""
    here = literal(True, "bool")
    for i, size, at in zip(index, ranges, place, strict=True):
        if size == 1:
            continue
        test = "le" if at == 0 else "ge" if at == size - 1 else "eq"
        same = apply(block, test, (i, literal(at, i.kind)), "bool", {})
        known = here.value is not None
        here = same if known else apply(block, "and", (here, same), "bool", {})
    return here


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
