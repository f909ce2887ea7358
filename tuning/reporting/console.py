"""Progress on standard error, where somebody is looking."""

import json
import os
import sys
from pathlib import Path
from typing import Any

from jaxglider.files.writing import replacing


class Progress:
    """One line that is written over; silent where standard error is no terminal."""

    def __init__(self) -> None:
        self._shown = 0
        self._live = sys.stderr.isatty()

    def show(self, text: str) -> None:
        """Replace the line."""
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


def note(text: str) -> None:
    """One line on standard error, always."""
    sys.stderr.write(f"jaxglider: {text}\n")


def print_result(result: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print a result as text or as JSON; a reader who has gone does no harm."""
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
    try:
        with replacing(folder / ".probe") as temporary:
            temporary.write_text("")
        (folder / ".probe").unlink()
    except OSError as error:
        raise OSError(f"--out {folder} cannot be written: {error}.") from error
