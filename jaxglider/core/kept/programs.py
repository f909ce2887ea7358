"""Programs that are traced once for all processes.

Before JAX finds a compiled program on disk, it traces the function anew: of a gradient
through a closed loop that takes ten times as long as what is left to do. A kept program
is the traced one, in the portable form of `jax.export`. It is found by a digest of all
that it is made of: the source of this project, versions, flags, the configuration of
JAX, the function with every value that it holds, and structure and types of its
arguments. What cannot be told so, or not be written down, is traced as ever: a law or
cost of the user's own, anything within another trace, a call back to Python.

Nothing is kept unless `keep_programs` names a folder. The commands do.
"""

import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxglider.core.kept.fingerprint import OWN, PINNED, code_fingerprint

F = TypeVar("F", bound=Callable[..., Any])
SWITCH = "JAXGLIDER_KEEP_PROGRAMS"
"""Variable of the environment that switches the keeping off where it is 0."""
_MOST = 256
"""Files in the folder; of more, those used longest ago go."""
_SILENT = ("cache", "log", "traceback")
"""Parts of names of JAX's settings that change no program."""
_folders: list[Path] = []
_UNREADABLE = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, IndexError),
    *(AttributeError, ImportError, RuntimeError, pickle.UnpicklingError),
)


def keep_programs(folder: Path | None) -> None:
    """Keep programs in a folder from now on, or no longer.

    Nothing is kept where the variable `SWITCH` is 0 or flatbuffers is not installed.

    Args:
        folder: folder, made when the first program is kept; None for none.
    """
    _folders.clear()
    wanted = os.environ.get(SWITCH, "1") != "0"
    if folder is not None and wanted and importlib.util.find_spec("flatbuffers"):
        _folders.append(folder)


def kept(function: F) -> F:
    """`jax.jit` of a pure function whose program is kept between processes.

    Args:
        function: pure function of pytrees; what in them is no array is static.
    """
    compiled, partly_static = jax.jit(function), eqx.filter_jit(function)
    known: dict[str, Callable[..., Any] | None] = {}
    content: list[str | None] = []

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        dynamic, static = eqx.partition(arguments, _is_array)
        leaves = jax.tree.leaves(dynamic)
        usual = partly_static if jax.tree.leaves(static) else compiled
        if not _folders or any(isinstance(x, jax.core.Tracer) for x in leaves):
            return usual(*arguments)
        if not content:  # told once: a pure function holds nothing that changes
            content.append(_content(function))
        digest = _digest(content[0], dynamic, static)
        if digest is None:
            return usual(*arguments)
        if digest not in known:
            try:
                known[digest] = _program(function, digest, dynamic, static)
            except Exception:  # not to be written down; its own errors come again
                known[digest] = None
        program = known[digest]
        return usual(*arguments) if program is None else program(leaves)

    call.compiled = compiled  # type: ignore[attr-defined]
    return cast(F, call)


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic)


def _content(value: Any) -> str | None:
    """Fingerprint of a value with its code; None where that cannot be told."""
    try:
        return code_fingerprint(value)
    except TypeError:
        return None


def _digest(content: str | None, dynamic: Any, static: Any) -> str | None:
    """Digest of a program; None where what it is made of cannot be told."""
    kinds = jax.tree.map(lambda x: str(jax.typeof(x)), dynamic)
    weak = [jax.typeof(x).weak_type for x in jax.tree.leaves(dynamic)]
    if any(jax.config.values[name] for name in ("jax_debug_nans", "jax_disable_jit")):
        return None
    taken = _content([kinds, weak, static])
    if content is None or taken is None:
        return None
    made_of = f"{_surroundings()} {content} {taken}"
    return hashlib.sha256(made_of.encode()).hexdigest()[:32]


def _surroundings() -> str:
    """All that makes a program what it is beside its function."""
    settings = {
        name: value
        for name, value in jax.config.values.items()
        if not any(part in name for part in _SILENT)
    }
    devices = [f"{x.platform} {x.device_kind}" for x in jax.devices()]
    flags = os.environ.get("XLA_FLAGS", "")
    return f"{_source()} {settings} {devices} {flags}"


@functools.cache
def _source() -> str:
    """Digest of this project's files and of the versions of what it is built on."""
    digest = hashlib.sha256(sys.version.encode())
    for name in PINNED:
        if name not in (*OWN, "builtins"):
            digest.update(f"{name} {importlib.metadata.version(name)}".encode())
    for name in OWN:
        found = importlib.util.find_spec(name)
        for root in (found and found.submodule_search_locations) or ():
            for path in sorted(Path(root).rglob("*")):
                if path.suffix in (".py", ".toml"):
                    digest.update(str(path.relative_to(root)).encode())
                    digest.update(path.read_bytes())
    return digest.hexdigest()


def _program(
    function: Callable[..., Any], digest: str, dynamic: Any, static: Any
) -> Callable[[Sequence[Any]], Any]:
    """The program of a digest, from the folder or traced and kept there."""
    path = _folders[0] / f"{digest}.program"
    try:
        found = _read(path)
    except _UNREADABLE:
        found = None
    if found is None:
        return _traced(function, path, dynamic, static)
    return _runner(*found)


def _read(path: Path) -> tuple[Any, Any, Any]:
    """The exported program, its results' structure, and their static parts."""
    exported, example, static = pickle.loads(path.read_bytes())
    os.utime(path)
    found = jax.export.deserialize(bytearray(exported))
    return found, jax.tree.structure(example), static


def _traced(
    function: Callable[..., Any], path: Path, dynamic: Any, static: Any
) -> Callable[[Sequence[Any]], Any]:
    """The program traced now, and kept where JAX can write it down."""
    structure = jax.tree.structure(dynamic)
    kinds = [_key_kind(x) for x in jax.tree.leaves(dynamic)]
    found: list[Any] = []

    def flat(*leaves: Any) -> list[Any]:
        whole = [_as_key(x, kind) for x, kind in zip(leaves, kinds, strict=True)]
        arguments = eqx.combine(jax.tree.unflatten(structure, whole), static)
        result, rest = eqx.partition(function(*arguments), _is_array)
        found[:] = [jax.tree.structure(result), rest]
        return jax.tree.leaves(result)

    flat.__name__ = getattr(function, "__name__", "program")
    inputs = [_as_data(x) for x in jax.tree.leaves(dynamic)]
    exported = jax.export.export(jax.jit(flat))(*inputs)
    results, rest = found
    if any(_is_key(kind) for kind in exported.out_avals):
        raise TypeError("a kept program gives no random keys.")
    _write(path, exported, results, rest)
    return _runner(exported, results, rest)


def _runner(exported: Any, results: Any, static: Any) -> Callable[[Sequence[Any]], Any]:
    def program(*inputs: Any) -> Any:
        return exported.call(*inputs)

    program.__name__ = exported.fun_name  # as JAX's logs tell programs apart
    run, place = jax.jit(program), None
    if exported.nr_devices > 1:
        devices = np.asarray(jax.devices()[: exported.nr_devices])
        place = NamedSharding(Mesh(devices, ("members",)), PartitionSpec())

    def call(leaves: Sequence[Any]) -> Any:
        inputs = [_as_data(x) for x in leaves]
        if place is not None:
            inputs = jax.device_put(inputs, place)
        return eqx.combine(jax.tree.unflatten(results, run(*inputs)), static)

    return call


def _write(path: Path, exported: Any, results: Any, static: Any) -> None:
    """Keep a program, under another name until it is whole; where it can be, alone."""
    example = jax.tree.unflatten(results, range(results.num_leaves))
    try:
        content = pickle.dumps((bytes(exported.serialize()), example, static))
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(content)
        Path(file.name).replace(path)
        programs = sorted(path.parent.glob("*.program"), key=_used, reverse=True)
        for old in programs[_MOST:]:
            old.unlink(missing_ok=True)
    except (*_UNREADABLE, pickle.PicklingError):
        return


def _used(path: Path) -> float:
    """Time that a file was last used; 0 if another process has just removed it."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _is_key(kind: Any) -> bool:
    return bool(jnp.issubdtype(kind.dtype, jax.dtypes.prng_key))


def _key_kind(leaf: Any) -> Any:
    """The kind of random key that a leaf is, or None."""
    return str(jr.key_impl(leaf)) if _is_key(leaf) else None


def _as_data(leaf: Any) -> Any:
    """A leaf as an array; what lies on several devices comes from there."""
    if _is_key(leaf):
        leaf = jr.key_data(leaf)
    if isinstance(leaf, jax.Array) and len(leaf.devices()) > 1:
        return jax.device_get(leaf)
    return leaf


def _as_key(leaf: Any, kind: Any) -> Any:
    return leaf if kind is None else jr.wrap_key_data(leaf, impl=kind)
