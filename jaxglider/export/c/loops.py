"""Scans in C: short ones written out, long ones as loops around a function of arrays.

A loop has a fixed number of steps. Its function takes an address for each array that
the scan reads, carries or stacks; what it carries is changed in place, once all of it
has been read.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxglider.export.c.block import C_TYPES, Block, Number
from jaxglider.export.c.outlined import Outlined, kind_of, opened
from jaxglider.export.c.shapes import Array, parts_of_scan, whole

WORTH_A_LOOP = 4000
"""Number of operations, in all steps of a scan, from which it becomes a loop."""

MANY_STEPS = 64
"""Number of steps above which a scan becomes one, however little is in it."""


@dataclasses.dataclass
class Addressed:
    """An array that the function of a loop takes by its address.

    Attributes:
        name: name of the argument.
        kind: kind of its numbers.
        written: flag, the function writes there.
    """

    name: str
    kind: str
    written: bool

    def declared(self) -> str:
        """The argument in a signature."""
        const = "" if self.written else "const "
        return f"{const}{C_TYPES[self.kind]} *{self.name}"


@dataclasses.dataclass
class Looped(Outlined):
    """The function of a loop: one step of a scan.

    Attributes:
        addressed: arrays that it takes.
        places: C expressions of the places that the results are written to.
    """

    addressed: list[Addressed] = dataclasses.field(default_factory=list)
    places: list[str] = dataclasses.field(default_factory=list)

    def signature(self) -> dict[str, str]:
        """Declarations of its arguments by their names."""
        return {a.name: a.declared() for a in self.addressed}

    def addresses(self) -> list[str]:
        """Nothing: the arrays that it writes are among its arguments."""
        return []

    def stores(self) -> list[str]:
        """Statements that write the results."""
        pairs = zip(self.places, self.results, strict=True)
        return [f"{place} = {r.text};" for place, r in pairs]


def scan(lowering: Any, equation: Any, x: list[Array]) -> list[Array]:
    """The results of a scan: the carry at its end, and the stacked outputs.

    Args:
        lowering: evaluation that the scan is a part of.
        equation: equation of the scan.
        x: constants, carry and rows of the scan.
    """
    params, (first, count) = equation.params, parts_of_scan(equation)
    constants, carry, rows = x[:first], x[first : first + count], x[first + count :]
    steps, body = params["length"], params["jaxpr"]
    operations = steps * _operations(opened(body))
    if steps > MANY_STEPS or (steps > 1 and operations > WORTH_A_LOOP):
        return _loop(lowering, equation, constants, carry, rows)
    order = range(steps)
    outputs: list[list[Array]] = []
    for n in reversed(order) if params["reverse"] else order:
        inputs = [np.asarray(r[n], dtype=object) for r in rows]
        results = lowering.closed(body, [*constants, *carry, *inputs])
        carry = results[:count]
        outputs.append(results[count:])
    if params["reverse"]:
        outputs.reverse()
    stacked = [np.stack(column) for column in zip(*outputs, strict=True)]
    return [*carry, *stacked]


def _operations(jaxpr: Any) -> int:
    """About how many operations on scalars a trace is."""
    total = 0
    for equation in jaxpr.eqns:
        size = sum(int(np.prod(v.aval.shape, dtype=int)) for v in equation.outvars)
        inside = [
            _operations(opened(part))
            for value in equation.params.values()
            for part in (value if isinstance(value, tuple | list) else [value])
            if hasattr(opened(part), "eqns")
        ]
        times = equation.params.get("length", 1)
        total += times * sum(inside) if inside else size
    return total


def _loop(
    lowering: Any,
    equation: Any,
    constants: Sequence[Array],
    carry: Sequence[Array],
    rows: Sequence[Array],
) -> list[Array]:
    """A scan as a loop."""
    block, params = lowering.block, equation.params
    steps, kinds = params["length"], [kind_of(v.aval.dtype) for v in equation.outvars]
    made, stacked = _step(lowering, params["jaxpr"], constants, carry, rows)
    arrays = {f"c{n}": a for n, a in enumerate(constants)}
    arrays |= {f"x{n}": r for n, r in enumerate(rows)}
    names = {a.name for a in made.addressed}
    tables = {
        name: block.table(a.ravel()[0].kind, list(a.ravel())).text
        for name, a in arrays.items()
        if name in names
    }
    stem = f"v{len(block.statements)}"
    own = {name: f"{stem}_{name}" for name in names if name[0] in "sy"}
    sizes = {f"x{n}": r.size // steps for n, r in enumerate(rows)}
    sizes |= {f"y{n}": part.size for n, part in enumerate(stacked)}
    number = f"{steps - 1} - n" if params["reverse"] else "n"
    given = []
    for argument in made.addressed:
        place, size = (own | tables)[argument.name], sizes.get(argument.name)
        given.append(place if size is None else f"{place} + {size} * ({number})")
    ends = [
        _named(f"{stem}_s{n}", a.shape, kind)
        for n, (a, kind) in enumerate(zip(carry, kinds, strict=False))
    ]
    outputs = [
        _named(f"{stem}_y{n}", (steps, *part.shape), kinds[len(carry) + n])
        for n, part in enumerate(stacked)
    ]
    lines = [
        f"{C_TYPES[kind]} {stem}_s{n}[] = {{{', '.join(x.text for x in a.ravel())}}};"
        for n, (a, kind) in enumerate(zip(carry, kinds, strict=False))
        if a.size
    ]
    lines += [
        f"{C_TYPES[kinds[len(carry) + n]]} {stem}_y{n}[{part.size}];"
        for n, part in enumerate(outputs)
        if part.size
    ]
    call = f"{made.name}({', '.join(given)});"
    lines.append(f"for (int n = 0; n < {steps}; n++) {{ {call} }}")
    defines = [(x.text, x.kind) for part in (*ends, *outputs) for x in part.ravel()]
    used = [x for a in carry for x in a.ravel()]
    used += [Number("real", name) for name in tables.values()]
    block.loop(defines, " ".join(lines), used, f"loop {steps} {made.name}")
    return [*ends, *outputs]


def _step(
    lowering: Any,
    body: Any,
    constants: Sequence[Array],
    carry: Sequence[Array],
    rows: Sequence[Array],
) -> tuple[Looped, list[Array]]:
    """The function of a loop, and what one step of it stacks."""
    made, count = Looped("", [], [], Block()), len(carry)
    fixed = [
        _inside(made, f"c{n}", a.ravel(), a.shape) for n, a in enumerate(constants)
    ]
    going = [_taken(made, f"s{n}", a, written=True) for n, a in enumerate(carry)]
    passing = [
        _taken(made, f"x{n}", np.asarray(r[0], dtype=object))
        for n, r in enumerate(rows)
    ]
    inside = lowering.within(made.block)
    results = inside.closed(body, [*fixed, *going, *passing])
    stacked = results[count:]
    for n, part in enumerate(stacked):
        if part.size:
            kind = part.ravel()[0].kind
            made.addressed.append(Addressed(f"y{n}", kind, written=True))
    for letter, group in (("s", results[:count]), ("y", stacked)):
        for n, part in enumerate(group):
            made.places += [f"{letter}{n}[{k}]" for k in range(part.size)]
            made.results += list(part.ravel())
    known = lowering.functions.outlined
    made.name = f"loop_{len(known) + 1}"
    known[made.name] = made
    return made, stacked


def _inside(
    made: Looped, name: str, numbers: Sequence[Number], shape: tuple[int, ...]
) -> Array:
    """Constants of a scan as the function of its loop sees them."""
    if all(x.value is not None or "." in x.text for x in numbers):
        return whole(list(numbers), shape)
    return _taken(made, name, whole(list(numbers), shape))


def _taken(made: Looped, name: str, like: Array, *, written: bool = False) -> Array:
    """An array that the function takes, read number by number."""
    numbers = list(like.ravel())
    if numbers:
        made.addressed.append(Addressed(name, numbers[0].kind, written))
    read = [
        made.block.load(x.kind, f"{name}_{k}", f"{name}[{k}]")
        for k, x in enumerate(numbers)
    ]
    return whole(read, like.shape)


def _named(name: str, shape: tuple[int, ...], kind: str) -> Array:
    size = int(np.prod(shape, dtype=int))
    return whole([Number(kind, f"{name}[{k}]", True) for k in range(size)], shape)
