"""Files written whole, under a temporary name first, and where a result is from."""

import datetime
import importlib.metadata
import json
import os
import platform
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when all went well.

    Raises:
        OSError: the folder cannot be made or written.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(
        dir=target.parent, prefix=f".{target.stem}-", suffix=target.suffix
    )
    os.close(handle)
    try:
        yield Path(name)
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    finally:
        Path(name).unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_text(path: str | Path, text: str) -> None:
    """Write a text file, replacing an old one only when the new one is complete.

    It is UTF-8 whatever the locale; what a file name has that is no text becomes `?`.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")


def provenance(**more: Any) -> dict[str, Any]:
    """Origin of a result: versions, hardware, time, and further entries."""
    versions = {
        name: importlib.metadata.version(name)
        for name in ("jaxglider", "jax", "jaxlib", "equinox", "numpy")
    }
    return {
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": {**versions, "python": platform.python_version()},
        "hardware": {
            "processor": _processor_name(),
            "cores": os.cpu_count(),
            "device": jax.devices()[0].device_kind,
            "backend": jax.default_backend(),
        },
        **more,
    }


def _processor_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def write_json(path: str | Path, data: Any) -> None:
    """Write JSON (no NaN: callers turn it into null)."""
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")
