"""Scalars of a C function and the statements that compute them.

Every statement defines new names and changes nothing else, so equal statements can be
shared and unused ones left out. What is known when the code is written is folded.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

C_TYPES = {
    "real": "glider_real",
    "bool": "bool",
    "int32": "int32_t",
    "int64": "int64_t",
    "uint32": "uint32_t",
    "uint64": "uint64_t",
}
"""Kinds of scalars and their types in C."""


class ExportError(ValueError):
    """Something cannot be written as C; the message names it."""


@dataclasses.dataclass(frozen=True)
class Number:
    """One scalar.

    Attributes:
        kind: key of `C_TYPES`.
        text: name or literal in C.
        varies: flag, it depends on a state or an input, not on parameters alone.
        value: value of the number, where that is known now.
    """

    kind: str
    text: str
    varies: bool = False
    value: Any = None


@dataclasses.dataclass(frozen=True)
class Statement:
    """One line of C that defines names.

    Attributes:
        defines: names and kinds.
        text: the line, without its indentation.
        uses: names it needs.
        operation: kind of operation, for their count.
        varies: flag as in `Number`.
    """

    defines: tuple[tuple[str, str], ...]
    text: str
    uses: tuple[str, ...]
    operation: str
    varies: bool


class Block:
    """The statements of one C function, in order.

    Attributes:
        of_one_precision: the function is written once for each floating format.
        statements: statements so far.
    """

    def __init__(self, *, of_one_precision: bool = False) -> None:
        self.of_one_precision = of_one_precision
        self.statements: list[Statement] = []
        self._seen: dict[tuple[str, str], tuple[Number, ...]] = {}

    def compute(
        self, kind: str, text: str, operands: Sequence[Number], operation: str
    ) -> Number:
        """A new scalar from an expression, or the one that already has it.

        Args:
            kind: kind of the result.
            text: the expression, its operands already in it.
            operands: numbers that it is computed from.
            operation: kind of operation.
        """
        key = (kind, text)
        if key not in self._seen:
            varies = any(x.varies for x in operands)
            name = f"v{len(self.statements)}"
            line = f"const {C_TYPES[kind]} {name} = {text};"
            self._add(((name, kind),), line, operands, operation, varies)
            self._seen[key] = (Number(kind, name, varies),)
        return self._seen[key][0]

    def call(
        self, function: str, kinds: Sequence[str], operands: Sequence[Number]
    ) -> tuple[Number, ...]:
        """The results of a function that takes scalars and writes to addresses."""
        arguments = ", ".join(x.text for x in operands)
        key = (function, arguments)
        if key not in self._seen:
            varies = any(x.varies for x in operands)
            stem = f"v{len(self.statements)}"
            names = [f"{stem}_{n}" for n in range(len(kinds))]
            declared = " ".join(
                f"{C_TYPES[k]} {n};" for k, n in zip(kinds, names, strict=True)
            )
            addresses = ", ".join(f"&{n}" for n in names)
            separator = ", " if arguments else ""
            line = f"{declared} {function}({arguments}{separator}{addresses});"
            defines = tuple(zip(names, kinds, strict=True))
            self._add(defines, line, operands, f"call {function}", varies)
            self._seen[key] = tuple(Number(k, n, varies) for n, k in defines)
        return self._seen[key]

    def table(self, kind: str, values: Sequence[Number]) -> Number:
        """An array of scalars, to be indexed; its text is the array's name."""
        given = ", ".join(x.text for x in values)
        key = (f"{kind}[]", given)
        if key not in self._seen:
            varies = any(x.varies for x in values)
            name = f"v{len(self.statements)}"
            line = f"const {C_TYPES[kind]} {name}[] = {{{given}}};"
            self._add(((name, kind),), line, values, "table", varies)
            self._seen[key] = (Number(kind, name, varies),)
        return self._seen[key][0]

    def loop(
        self,
        defines: Sequence[tuple[str, str]],
        text: str,
        operands: Sequence[Number],
        operation: str,
    ) -> None:
        """A loop and the arrays that it fills.

        Args:
            defines: elements of the arrays and their kinds.
            text: declarations and the loop.
            operands: numbers and arrays that it needs.
            operation: kind of operation, for their count.
        """
        self._add(tuple(defines), text, operands, operation, True)

    def load(self, kind: str, name: str, text: str) -> Number:
        """A field of a structure, read before anything is written."""
        line = f"const {C_TYPES[kind]} {name} = {text};"
        self._add(((name, kind),), line, (), "load", True)
        return Number(kind, name, True)

    def _add(
        self,
        defines: tuple[tuple[str, str], ...],
        text: str,
        operands: Sequence[Number],
        operation: str,
        varies: bool,
    ) -> None:
        uses = tuple(x.text for x in operands if x.value is None)
        self.statements.append(
            Statement(
                defines=defines,
                text=text,
                uses=uses,
                operation=operation,
                varies=varies,
            )
        )

    def needed(self, results: Sequence[Number]) -> list[Statement]:
        """The statements that the results depend on."""
        wanted = {x.text for x in results}
        statements = []
        for statement in reversed(self.statements):
            if any(name in wanted for name, _ in statement.defines):
                wanted.update(statement.uses)
                statements.append(statement)
        return statements[::-1]


def literal(value: Any, kind: str) -> Number:
    """A number that is known now."""
    if kind == "bool":
        return Number(
            kind=kind,
            text="true" if value else "false",
            varies=False,
            value=np.bool_(value),
        )
    if kind != "real":
        whole = np.dtype(kind).type(value)
        return Number(
            kind=kind,
            text=f"{C_TYPES[kind].upper()[:-2]}_C({int(whole)})",
            varies=False,
            value=whole,
        )
    real = float(value)
    if np.isnan(real):
        text = "NAN"
    elif np.isinf(real):
        text = "INFINITY" if real > 0 else "-INFINITY"
    else:
        text = repr(real)
    return Number(kind=kind, text=f"REAL({text})", varies=False, value=value)
