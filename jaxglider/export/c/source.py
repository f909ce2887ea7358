"""Structures and functions of C: headers and sources as text."""

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from jaxglider.export.c.block import C_TYPES, Block, Statement, literal
from jaxglider.export.c.fields import Field, fields_of
from jaxglider.export.c.lowering import lower
from jaxglider.export.c.outlined import Functions, Outlined

_WIDTH = 96


@dataclasses.dataclass(frozen=True)
class Structure:
    """A structure of C for a pytree.

    Attributes:
        name: name of the type.
        summary: sentence that describes it.
        example: the pytree.
        hidden: parts of it whose names are left out.
        origins: numbers that some fields count from in the trace, as C, by their names.
    """

    name: str
    summary: str
    example: Any
    hidden: tuple[str, ...] = ()
    origins: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def fields(self) -> list[Field]:
        """Its fields."""
        return [
            dataclasses.replace(field, origin=self.origins.get(field.name, ""))
            for field in fields_of(self.example, self.hidden)
        ]

    def declaration(self) -> str:
        """The typedef."""
        lines = [f"    {f.declaration()}" for f in self.fields()]
        if not lines:
            lines = ["    char nothing; /* it has no memory */"]
        body = "\n".join(lines)
        return f"/* {self.summary} */\ntypedef struct {{\n{body}\n}} {self.name};\n"

    def size(self, real: int) -> int:
        """Bytes, where a floating number takes `real`; padded as on most machines."""
        sizes = {"real": real, "bool": 1, "int32": 4, "uint32": 4}
        at, widest = 0, 1
        for field in self.fields():
            width = 8 if field.origin else sizes.get(field.kind, 8)
            at = -(-at // width) * width + width * field.size
            widest = max(widest, width)
        return -(-at // widest) * widest


@dataclasses.dataclass(frozen=True)
class Argument:
    """An argument of a C function: the address of a structure.

    Attributes:
        name: name of the argument.
        structure: structure it points at.
        reads: flag, it is an argument of the function that is traced.
        writes: flag, it takes one of that function's results.
    """

    name: str
    structure: Structure
    reads: bool = True
    writes: bool = False


@dataclasses.dataclass
class Written:
    """A C function.

    Attributes:
        prototype: prototype without the semicolon.
        summary: sentence that describes it.
        text: the whole of it.
        statements: statements that it needs.
    """

    prototype: str
    summary: str
    text: str
    statements: list[Statement]


def write_function(
    name: str,
    summary: str,
    function: Callable[..., Any],
    parameters: tuple[str, Any],
    arguments: Sequence[Argument],
    functions: Functions,
) -> Written:
    """A C function from a pure one.

    Args:
        name: name of the C function.
        summary: sentence that describes it.
        function: pure function; takes the parameters and every argument that is read,
            in order; returns a tuple with a result for every argument that is written.
        parameters: name of the constant structure, and its pytree.
        arguments: arguments of the C function.
        functions: functions of the file, shared with its other functions.
    """
    block = Block()
    numbers = []
    owner, tree = parameters
    for field in fields_of(tree):
        numbers.append(field.numbers(f"{owner}.", varies=False))
    read = [a for a in arguments if a.reads]
    for argument in read:
        for field in argument.structure.fields():
            numbers.append(_loaded(block, argument.name, field))
    examples = [tree, *(a.structure.example for a in read)]
    results = lower(block, function, examples, numbers, functions)
    targets = [
        (field, f"{a.name}->")
        for a in arguments
        if a.writes
        for field in a.structure.fields()
    ]
    stores, wanted = [], []
    for (field, place), result in zip(targets, results, strict=True):
        for to, number in zip(field.places(place), result.ravel(), strict=True):
            stores.append(f"{to} = {number.text};")
            wanted.append(number)
    statements = block.needed(wanted)
    used = " ".join(s.text for s in statements) + " ".join(stores)
    unread = [a.name for a in arguments if not re.search(rf"\b{a.name}->", used)]
    signature = ", ".join(_declared(a) for a in arguments)
    prototype = f"void {name}({signature})"
    body = [f"(void){n};" for n in unread]
    body += [s.text for s in statements] + stores
    return Written(
        prototype=prototype,
        summary=summary,
        text=_function(prototype, body),
        statements=statements,
    )


def _declared(argument: Argument) -> str:
    const = "" if argument.writes else "const "
    return f"{const}{argument.structure.name} *{argument.name}"


def _loaded(block: Block, owner: str, field: Field) -> Any:
    """A field of an argument, read into names of its own."""
    numbers = field.numbers(f"{owner}->", varies=True)
    for n, number in enumerate(numbers.ravel()):
        name = f"{owner}_{field.name}" + (f"_{n}" if field.shape else "")
        text = number.text
        if field.origin:
            text = f"({C_TYPES[field.kind]})({text} - {field.origin})"
        loaded = block.load(field.kind, name, text)
        numbers.flat[n] = loaded
    return numbers


def _function(prototype: str, body: Sequence[str]) -> str:
    lines = "\n".join(_wrapped(line) for line in body)
    return f"{prototype}\n{{\n{lines}\n}}\n"


def _wrapped(line: str) -> str:
    """A statement, broken at blanks where it is long."""
    parts, rows = line.split(" "), ["   "]
    for part in parts:
        if len(rows[-1]) + 1 + len(part) > _WIDTH and rows[-1].strip():
            rows.append("       ")
        rows[-1] += f" {part}"
    return "\n".join(rows)


def helper_text(functions: Functions) -> str:
    """All outlined functions, the elementary ones for either precision."""
    double = [_static(pair[0]) for pair in functions.elementary.values()]
    single = [_static(pair[1]) for pair in functions.elementary.values()]
    parts = []
    if double:
        parts.append(
            "#ifdef GLIDER_FLOAT\n"
            + "\n".join(single)
            + "\n#else\n"
            + "\n".join(double)
            + "\n#endif\n"
        )
    return "\n".join([*parts, *(_static(f) for f in functions.outlined.values())])


def _static(function: Outlined) -> str:
    arguments = function.signature()
    statements = function.block.needed(function.results)
    stores = function.stores()
    used = " ".join([*(s.text for s in statements), *stores])
    body = [
        f"(void){name};" for name in arguments if not re.search(rf"\b{name}\b", used)
    ]
    body += [s.text for s in statements] + stores
    signature = ", ".join([*arguments.values(), *function.addresses()])
    return _function(f"static void {function.name}({signature})", body)


def constants_text(kind: str, name: str, tree: Any) -> str:
    """The definition of the constant structure that holds a pytree's numbers.

    Args:
        kind: name of the structure's type.
        name: name of the constant.
        tree: pytree of the numbers.
    """
    lines = []
    for field, leaf in zip(fields_of(tree), jax.tree.leaves(tree), strict=True):
        values = [literal(x, field.kind).text for x in np.asarray(leaf).ravel()]
        value = f"{{{', '.join(values)}}}" if field.shape else values[0]
        lines.append(f"    .{field.name} = {value},")
    body = "\n".join(lines)
    return f"const {kind} {name} = {{\n{body}\n}};\n"
