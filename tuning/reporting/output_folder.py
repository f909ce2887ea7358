"""A folder of results that one process writes at a time."""

import contextlib
import fcntl
import json
import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from tuning.reporting.console import check_writable, note

LOCK = ".being-written"
"""Name of the file that is locked; it is there while a command writes."""

_held: set[Path] = set()


def folder_name(folder: Path) -> str:
    """A folder for a sentence: the working folder, `.`, by its whole path."""
    return str(folder.absolute() if folder == Path() else folder)


@contextlib.contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder.

    The lock is the operating system's, so it goes with the process, however that ends.
    A folder that was made for this and stays empty is removed again. Within the block,
    more blocks of the same process for the same folder change nothing.

    Args:
        folder: folder to write to; made if it is not there.

    Raises:
        ValueError: another process is writing to it.
        OSError: it cannot be made or written.
    """
    place = folder.resolve()
    if place in _held:
        yield
        return
    new = [p for p in (place, *place.parents) if not p.exists()]
    try:
        check_writable(folder)
        lock = _locked(folder)
        _held.add(place)
        try:
            yield
        finally:
            _held.discard(place)
            if lock is not None:
                (place / LOCK).unlink(missing_ok=True)
                os.close(lock)
    finally:
        with contextlib.suppress(OSError):
            for path in new:
                path.rmdir()


_SAME_RESULT = ("--overwrite", "--resume", "--json", "--verbose", "--debug")
"""Options that change nothing of what is written."""


def keep_other_results(
    path: Path, command: Sequence[str], *, overwrite: bool = False
) -> None:
    """Refuse to replace results that another command wrote.

    The same command may write its results again.

    Args:
        path: JSON file of the results, with their provenance.
        command: words of the command line that is about to write it.
        overwrite: whether results of others may be replaced.

    Raises:
        ValueError: they are those of another command.
    """
    if overwrite or not path.is_file():
        return
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        before = [str(word) for word in content["provenance"]["command"]]
    except (OSError, ValueError, KeyError, TypeError):
        before = ["?"]
    if _result_of(before) != _result_of(command):
        raise ValueError(
            f"--out {folder_name(path.parent)} holds the results of another command, "
            f"`jaxglider {shlex.join(before)}`: give another folder, or replace them "
            "by --overwrite."
        )


def _result_of(command: Sequence[str]) -> list[str]:
    return [word for word in command if word not in _SAME_RESULT]


def _locked(folder: Path) -> int | None:
    """The open file that holds the lock; None where there are no locks."""
    path = folder.resolve() / LOCK
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_still(path, handle):
                return handle
        except BlockingIOError:
            os.close(handle)
            raise ValueError(
                f"{folder} is being written by another process; wait for it, or give "
                "another folder."
            ) from None
        except OSError as error:
            note(
                f"{folder} is where files cannot be locked ({error.strerror}): see to "
                "it that no other process writes to it."
            )
            path.unlink(missing_ok=True)
            os.close(handle)
            return None
        os.close(handle)


def _is_still(path: Path, handle: int) -> bool:
    """Whether a path is still that of an open file: its last owner removes it."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except FileNotFoundError:
        return False
