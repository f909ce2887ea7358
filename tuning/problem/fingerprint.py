"""A digest of a value and of everything that it holds, the same in every process."""

import dataclasses
import hashlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np


def fingerprint(value: Any) -> str:
    """Sixteen hexadecimal digits that change with anything the value holds.

    Arrays count by shape, type and bytes, functions and classes of this project by
    their name and others by the file they are in, containers by what they hold.

    Args:
        value: any tree of dataclasses, containers, arrays, functions and plain values.

    Raises:
        TypeError: it holds something whose content cannot be told.
    """
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part.encode() if isinstance(part, str) else part)
        digest.update(b"\0")
    return digest.hexdigest()[:16]


def _parts(value: Any) -> Iterator[str | bytes]:
    """The value as a sequence of texts and bytes; two that differ differ here."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        yield from _array_parts(value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from _code_parts(type(value))
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, dict):
        yield "dict"
        for key in sorted(value, key=repr):
            yield repr(key)
            yield from _parts(value[key])
    elif isinstance(value, list | tuple | set | frozenset):
        items = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
        yield f"{len(items)} items"
        for item in items:
            yield from _parts(item)
    elif isinstance(value, type) or callable(value):
        yield from _code_parts(value)
    elif value is None or isinstance(value, str | bytes | int | float | complex | Path):
        yield f"{type(value).__name__} {value!r}"
    else:
        raise TypeError(f"no fingerprint of {value!r}: its content cannot be told.")


def _array_parts(value: Any) -> Iterator[str | bytes]:
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    array = np.asarray(value)
    yield f"{array.dtype} {array.shape}"
    yield array.tobytes()


def _code_parts(value: Any) -> Iterator[str | bytes]:
    name = getattr(value, "__qualname__", type(value).__qualname__)
    yield f"{value.__module__}.{name}"
    if value.__module__.partition(".")[0] in ("jaxglider", "tuning"):
        return
    try:
        # A function of the user's own may lean on anything in its file.
        file = Path(inspect.getsourcefile(value) or "")
        yield file.read_text(encoding="utf-8")
    except (OSError, TypeError):
        code = getattr(value, "__code__", None)
        yield b"" if code is None else code.co_code
