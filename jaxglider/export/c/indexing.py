"""Primitives that take numbers from a place in an array, or put them there.

An index that is only known on board becomes a chain of selections, or, where there is
much to choose from, one into a table.
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
from jaxglider.export.c.shapes import Array, whole

FEW = 8
"""Places among which one index chooses by selections; among more, from a table."""

MAX_CHOICES = 1024
"""Longest chain of selections for several indices."""


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
        return whole([pool[n] for n in np.ravel(chosen)], shape)

    kind = operand.ravel()[0].kind
    missing = literal(np.nan if kind == "real" else 0, kind)
    pool = [*operand.ravel(), missing]
    if all(i.value is not None for i in parts):
        return slice_at([int(i.value) for i in parts])
    if indices.size != indices.shape[-1]:
        raise ExportError(unsupported("gather", " at several places at once"))
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
            result[place] = apply(
                block, "select_n", (outside, old, missing), old.kind, {}
            )
    return result


def pad(x: Sequence[Array], config: Any) -> Array:
    """An array with a number around and between its own, or with some cut off.

    Args:
        x: operand and number to pad with.
        config: `padding_config` of the primitive.
    """
    operand, filler = x
    numbering = jnp.arange(operand.size).reshape(operand.shape)
    where = np.asarray(lax.pad(numbering, jnp.asarray(-1, numbering.dtype), config))
    pool = [*operand.ravel(), filler[()]]
    return whole([pool[n] for n in where.ravel()], where.shape)


def scatter(block: Block, name: str, x: Sequence[Array], params: Any) -> Array:
    """An array with numbers put in, or added, at places known when this is written.

    Args:
        block: block that takes the statements.
        name: name of the primitive, `scatter` or `scatter-add`.
        x: operand, index and updates.
        params: parameters of the primitive.

    Raises:
        ExportError: a place is known on board only, or is given twice.
    """
    operand, indices, updates = x
    if any(i.value is None for i in indices.ravel()):
        raise ExportError(unsupported(name, " at a place known on board only"))
    place = jnp.asarray(np.array([int(i.value) for i in indices.ravel()]))
    numbers = jnp.arange(updates.size).reshape(updates.shape)
    nowhere = jnp.full(operand.shape, -1)
    where = np.asarray(
        lax.scatter(
            nowhere,
            place.reshape(indices.shape),
            numbers,
            params["dimension_numbers"],
            mode=params["mode"],
        )
    )
    if np.sum(where >= 0) < updates.size:
        raise ExportError(unsupported(name, " twice at one place, or outside"))
    result, given = np.array(operand, dtype=object), updates.ravel()
    for at in zip(*np.nonzero(where >= 0), strict=True):
        new = given[where[at]]
        if name == "scatter-add":
            new = apply(block, "add", (result[at], new), new.kind, {})
        result[at] = new
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
