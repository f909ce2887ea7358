"""Checks of types and shapes at each call of the library, at half their price.

`jaxtyping` remembers the sizes of named axes over a call, so that " n" is the same
length in all arguments and the result. That is bookkeeping of 30 µs a call, and nearly
all functions name no axis: these are checked by beartype alone, in the same way.
"""

import dataclasses
import functools
import inspect
import typing
from typing import Any

import jaxtyping
from jaxtyping import AbstractArray

_remembering = jaxtyping.jaxtyped


def install(modules: list[str]) -> None:
    """Check all calls of these modules, which are not imported yet."""
    jaxtyping.jaxtyped = _checked
    jaxtyping.install_import_hook(modules, "beartype.beartype")


def _checked(what: Any = None, *, typechecker: Any) -> Any:
    """In the place of `jaxtyping.jaxtyped`, where the import hook looks for it."""
    if what is None:
        return functools.partial(_checked, typechecker=typechecker)
    if inspect.isfunction(what) and not _needs_memory(what):
        return typechecker(what)
    if not inspect.isclass(what):
        return _remembering(what, typechecker=typechecker)
    made = what.__dict__.get("__init__")
    if dataclasses.is_dataclass(what) and made and not hasattr(made, "__wrapped__"):
        what.__init__ = _checked(made, typechecker=typechecker)
    return what


def _needs_memory(function: Any) -> bool:
    """Whether an axis is named, or an annotation is still text."""
    hints = list(inspect.get_annotations(function).values())
    while hints:
        hint = hints.pop()
        if isinstance(hint, str | typing.ForwardRef):
            return True
        if inspect.isclass(hint) and issubclass(hint, AbstractArray):
            if hint.dim_str.strip():
                return True
        else:
            hints.extend(typing.get_args(hint))
    return False
