"""A digest of a value and of everything that it holds, the same in every process."""

import dataclasses
import enum
import functools
import hashlib
import inspect
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

OWN = ("jaxglider", "tuning")
"""Packages of this project."""
PINNED = (*OWN, "jax", "jaxlib", "equinox", "optax", "numpy", "builtins")
"""Packages whose code `code_fingerprint` tells by name, beside their versions."""
_PLAIN = str | bytes | int | float | complex | Path | range


def fingerprint(value: Any) -> str:
    """Sixteen hexadecimal digits that change with anything the value holds.

    Arrays count by shape, type and bytes, functions and classes of this project by
    their name and others by the file they are in, containers by what they hold.

    Args:
        value: any tree of dataclasses, containers, arrays, functions and plain values.

    Raises:
        TypeError: it holds something whose content cannot be told.
    """
    return _digest(value, _named)


def code_fingerprint(value: Any) -> str:
    """The same, and of functions also what they hold: all that a program is made of.

    Of a method that is its object, of a nested function what it takes from the function
    around it. Code itself is told by name and place: beside this digest stand the
    source of this project and the versions of `PINNED`.

    Args:
        value: tree as of `fingerprint`, with code of `PINNED` packages only.

    Raises:
        TypeError: it holds code of another package, which may lean on anything, or
            something whose content cannot be told.
    """
    return _digest(value, _whole)


_Tell = Callable[[Any], Iterator[Any]]


def _digest(value: Any, tell: _Tell) -> str:
    digest = hashlib.sha256()
    for part in _parts(value, tell):
        digest.update(part.encode() if isinstance(part, str) else part)
        digest.update(b"\0")
    return digest.hexdigest()[:16]


def _parts(value: Any, tell: _Tell) -> Iterator[str | bytes]:
    """The value as a sequence of texts and bytes; two that differ differ here.

    Args:
        value: value.
        tell: function that gives texts of code, and further values that it holds.
    """
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        yield from _array_parts(value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from _code_parts(type(value), tell)
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name), tell)
    elif isinstance(value, dict):
        yield "dict"
        for key in sorted(value, key=repr):
            yield repr(key)
            yield from _parts(value[key], tell)
    elif isinstance(value, list | tuple | set | frozenset):
        items = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
        yield f"{len(items)} items"
        for item in items:
            yield from _parts(item, tell)
    elif isinstance(value, enum.Enum):
        yield f"{type(value).__qualname__}.{value.name}"
    elif isinstance(value, type) or callable(value):
        yield from _code_parts(value, tell)
    elif value is None or isinstance(value, _PLAIN):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, jax.Device):
        yield f"{value.platform} {value.device_kind} {value.id}"
    elif isinstance(value, types.ModuleType) and _is_pinned(value.__name__):
        yield value.__name__
    else:
        raise TypeError(f"no fingerprint of {value!r}: its content cannot be told.")


def _array_parts(value: Any) -> Iterator[str | bytes]:
    if isinstance(value, jax.core.Tracer):
        raise TypeError("no fingerprint of a traced number: it has no value yet.")
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    array = np.asarray(value)
    weak = " weak" if isinstance(value, jax.Array) and value.aval.weak_type else ""
    yield f"{array.dtype} {array.shape}{weak}"
    yield array.tobytes()


def _code_parts(value: Any, tell: _Tell) -> Iterator[str | bytes]:
    for part in tell(value):
        if isinstance(part, str | bytes):
            yield part
        else:
            yield from _parts(part, tell)


def _named(value: Any) -> Iterator[str | bytes]:
    """Name of a function or class, and of one of a user's own the file."""
    name = getattr(value, "__qualname__", type(value).__qualname__)
    yield f"{value.__module__}.{name}"
    if value.__module__.partition(".")[0] in OWN:
        return
    try:
        # A function of the user's own may lean on anything in its file.
        file = Path(inspect.getsourcefile(value) or "")
        yield file.read_text(encoding="utf-8")
    except (OSError, TypeError):
        code = getattr(value, "__code__", None)
        yield b"" if code is None else code.co_code


def _whole(value: Any) -> Iterator[Any]:
    """Name and place of a function or class, then all values that it holds."""
    if isinstance(value, functools.partial):
        yield "partial"
        yield [value.func, value.args, value.keywords]
        return
    if isinstance(value, types.MethodType):
        yield "method"
        yield [value.__func__, value.__self__]
        return
    module = getattr(value, "__module__", None) or ""
    known = _is_pinned(module)
    if isinstance(value, type | types.BuiltinFunctionType | np.ufunc) and known:
        yield f"{module}.{getattr(value, '__qualname__', value.__name__)}"
        return
    inner = getattr(value, "__wrapped__", None)
    if known and inner is not None and not isinstance(value, types.FunctionType):
        yield f"{type(value).__qualname__} of"  # a compiled function
        yield [inner]
        return
    if known and hasattr(value, "compiled"):
        yield "kept"  # by the table of its programs it would change
        yield [inner]
        return
    if not known or not isinstance(value, types.FunctionType):
        raise TypeError(f"no fingerprint of {value!r}: what it leans on is not known.")
    code = value.__code__
    yield f"{module}.{value.__qualname__} {code.co_name} {code.co_firstlineno}"
    yield code.co_code
    cells = [cell.cell_contents for cell in value.__closure__ or ()]
    yield [cells, value.__defaults__, value.__kwdefaults__]


def _is_pinned(module: str) -> bool:
    return module.partition(".")[0] in PINNED
