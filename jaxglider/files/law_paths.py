"""Names of laws of a user's own, FILE.py:ClassName, and the paths in them."""

import os
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError


def is_own(kind: Any) -> bool:
    """Whether a law is named as FILE.py:ClassName, and not by a word."""
    return isinstance(kind, str) and kind.rpartition(":")[0].endswith(".py")


def short_name(kind: str) -> str:
    """Name of a law in a result: its word, or the name of its class."""
    return kind.rpartition(":")[2]


def is_same_law(one: str, other: str) -> bool:
    """Whether two names stand for one law, however the path of its file is spelt."""
    if one == other or not (is_own(one) and is_own(other)):
        return one == other
    files = [Path(kind.rpartition(":")[0]) for kind in (one, other)]
    same = all(file.is_file() for file in files) and os.path.samefile(*files)
    return same and short_name(one) == short_name(other)


def seen_from(folder: str | Path, kind: str) -> str:
    """The name of a law for a file in a folder, that it may be loaded from anywhere.

    Args:
        folder: folder of the file that the name is written to.
        kind: name of the law; one of the catalogue stays as it is.

    Returns:
        FILE.py:ClassName with the path from that folder, or the whole path where the
        two have no folder above them but the root.
    """
    file, _, name = kind.rpartition(":")
    if not is_own(kind) or not Path(file).is_file():
        return kind
    law, home = Path(file).absolute(), Path(folder).resolve()
    law = law.parent.resolve() / law.name
    if law.drive != home.drive or os.path.commonpath((law, home)) == law.anchor:
        return f"{law}:{name}"
    return f"{Path(os.path.relpath(law, home)).as_posix()}:{name}"


def found_from(folder: Path, kind: str) -> str:
    """The name of a law in a file of a folder, with a path that leads to the law.

    A relative path is looked for in that folder, then in the working folder.

    Raises:
        ConfigError: it is in neither.
    """
    file, _, name = kind.rpartition(":")
    beside = folder / file
    if beside.is_file():
        short = Path(os.path.normpath(beside))
        # Through a link, `..` is not the folder that it seems to be.
        same = short.is_file() and os.path.samefile(short, beside)
        return f"{short if same else beside}:{name}"
    if Path(file).is_file():
        return kind
    places = dict.fromkeys((os.path.abspath(beside), os.path.abspath(file)))
    raise ConfigError(
        f"controller.type is {kind!r}, but there is no such file: looked for "
        f"{' and '.join(places)}. Put the law's file there, or write where it is in "
        "controller.type."
    )
