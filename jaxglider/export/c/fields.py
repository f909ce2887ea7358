"""Pytrees as structures of C: a named field for each leaf, with what is known of it.

The comment beside a field is the line of the class that owns it, unit and all.
"""

import dataclasses
import inspect
import re
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jaxglider.export.c.block import C_TYPES, Number
from jaxglider.export.c.outlined import kind_of
from jaxglider.export.c.shapes import Array, whole
from jaxglider.signals import BodyAxes, Channels, Command

_EACH = (BodyAxes, Channels, Command)
"""Containers whose own fields are described by the field that holds the container."""

_RESERVED = frozenset(
    [
        "auto",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
        "bool",
        "true",
        "false",
    ]
)


@dataclasses.dataclass(frozen=True)
class Field:
    """One leaf of a pytree.

    Attributes:
        name: name of the field in C.
        kind: kind of its scalars.
        shape: shape of the leaf.
        comment: meaning and unit of the field.
        origin: C expression of what it counts from in the trace, or an empty text; the
            field is then in double precision whatever the rest is in.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    comment: str
    origin: str = ""

    @property
    def size(self) -> int:
        """Number of its scalars."""
        return int(np.prod(self.shape, dtype=int))

    def places(self, owner: str) -> list[str]:
        """The C expression of each scalar, `owner` being what comes before the name."""
        if not self.shape:
            return [f"{owner}{self.name}"]
        return [f"{owner}{self.name}[{n}]" for n in range(self.size)]

    def declaration(self) -> str:
        """The line of the structure."""
        count = f"[{self.size}]" if self.shape else ""
        comment = f" /* {self.comment} */" if self.comment else ""
        kind = "double" if self.origin else C_TYPES[self.kind]
        return f"{kind} {self.name}{count};{comment}"

    def numbers(self, owner: str, *, varies: bool) -> Array:
        """Its scalars, as they stand in C."""
        texts = self.places(owner)
        return whole([Number(self.kind, t, varies) for t in texts], self.shape)


def fields_of(tree: Any, hidden: Sequence[str] = ()) -> list[Field]:
    """The fields of a pytree, in the order of its leaves.

    Args:
        tree: the pytree; shapes will do.
        hidden: parts of it whose names are left out of the names of fields.

    Raises:
        ExportError: a leaf is of a type that C has not.
    """
    fields: list[Field] = []
    names: set[str] = set()
    for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]:
        array = np.asarray(leaf) if not hasattr(leaf, "dtype") else leaf
        name = _name([k for k in path if _key(k) not in hidden])
        while name in names:
            name += "_"
        names.add(name)
        comment = _comment(tree, path)
        fields.append(
            Field(
                name=name,
                kind=kind_of(array.dtype),
                shape=tuple(array.shape),
                comment=comment,
            )
        )
    return fields


def _name(path: Sequence[Any]) -> str:
    """The path with underscores, a legal name in C."""
    text = "_".join(_key(k) for k in path) or "value"
    text = re.sub(r"\W", "_", text, flags=re.ASCII)
    if text[0].isdigit() or text in _RESERVED:
        text = f"x_{text}"
    return text


def _key(entry: Any) -> str:
    for attribute in ("name", "key", "idx"):
        if hasattr(entry, attribute):
            return str(getattr(entry, attribute))
    return str(entry)


def _comment(tree: Any, path: Sequence[Any]) -> str:
    """Description of a leaf by the classes along its path, the last one first."""
    comment = ""
    here = tree
    for entry in path:
        key = _key(entry)
        if isinstance(here, eqx.Module):
            text = attributes(type(here)).get(key, "")
            if text and not (comment and isinstance(here, _EACH)):
                comment = text
            elif comment:
                comment = f"{comment} ({key})"
            here = getattr(here, key, None)
        else:
            comment = f"{comment} ({key})" if comment else ""
            try:
                here = here[getattr(entry, "key", getattr(entry, "idx", None))]
            except (TypeError, KeyError, IndexError):
                here = None
    return comment.replace("*/", "* /")


def attributes(kind: type) -> dict[str, str]:
    """The section `Attributes:` of a class's docstring, name by name."""
    text = inspect.cleandoc(kind.__doc__ or "")
    _, heading, section = text.partition("Attributes:\n")
    if not heading:
        return {}
    lines: dict[str, str] = {}
    name = ""
    for line in section.splitlines():
        if line and not line.startswith(" "):
            break
        entry = re.match(r" {4}(\w+): (.*)", line)
        if entry:
            name = entry[1]
            lines[name] = entry[2]
        elif name and line.strip():
            lines[name] += f" {line.strip()}"
    return {k: v.rstrip(".") for k, v in lines.items()}
