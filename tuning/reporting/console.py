"""Progress on standard error, where somebody is looking."""

import json
import os
import sys
from pathlib import Path
from typing import Any

from jaxglider.core.toml import reason
from jaxglider.files.writing import replacing


class Progress:
    """One line that is written over; silent where standard error is no terminal."""

    def __init__(self) -> None:
        self._shown = 0
        self._live = sys.stderr.isatty()

    def show(self, text: str, at: int | None = None, total: int | None = None) -> None:
        """Replace the line.

        Args:
            text: line to show.
            at: amount of work done, for a bar; the line says it itself.
            total: amount of work in all.
        """
        if self._live:
            sys.stderr.write("\r" + text.ljust(self._shown))
            sys.stderr.flush()
            self._shown = len(text)

    def clear(self) -> None:
        """Remove the line."""
        if self._live and self._shown:
            sys.stderr.write("\r" + " " * self._shown + "\r")
            sys.stderr.flush()
            self._shown = 0


class SilentProgress(Progress):
    """Shows nothing."""

    def show(self, text: str, at: int | None = None, total: int | None = None) -> None:
        """Show nothing."""


class BarProgress(Progress):
    """A bar of tqdm, which a notebook draws too; silent where nobody is looking."""

    def __init__(self) -> None:
        super().__init__()
        self._bar: Any = None

    def show(self, text: str, at: int | None = None, total: int | None = None) -> None:
        """Say what is done, and how much of it.

        Args:
            text: line to show.
            at: amount of work done.
            total: amount of work in all.
        """
        from tqdm.auto import tqdm

        if self._bar is None or self._bar.total != total:
            self.clear()
            look = "{desc}" if total is None else "{bar:20} {desc}"
            in_notebook = tqdm.__module__.endswith("notebook")
            self._bar = tqdm(
                total=total,
                leave=False,
                bar_format=look,
                disable=False if in_notebook else None,
            )
        self._bar.n = at or 0
        self._bar.set_description_str(text)

    def clear(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def note(text: str) -> None:
    """One line on standard error, always."""
    sys.stderr.write(f"jaxglider: {text}\n")


def print_result(result: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print a result as text or as JSON; a reader who has gone does no harm.

    Args:
        result: plain numbers, lists and strings.
        text: text for a terminal.
        as_json: flag, print the result as JSON instead of the text.
    """
    try:
        sys.stdout.write(
            json.dumps(result, indent=2, allow_nan=False) if as_json else text
        )
        sys.stdout.write("\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Stop Python from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def check_writable(folder: Path) -> None:
    """Refuse a folder before the work, not after it.

    Raises:
        OSError: it cannot be made or written.
    """
    place = folder.absolute()
    for path in (place, *place.parents):
        if path.exists() and not path.is_dir():
            raise NotADirectoryError(
                f"--out must be a folder; received {folder}, but {path} is a file. "
                "Give another name, or move that file away."
            )
    try:
        with replacing(folder / ".probe") as temporary:
            temporary.write_text("", encoding="utf-8")
        (folder / ".probe").unlink()
    except OSError as error:
        raise OSError(
            f"--out {folder} cannot be written: {reason(error)} ({place}). Give a "
            "folder that you may write to."
        ) from error
