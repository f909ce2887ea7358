"""Progress on standard error, where somebody is looking."""

import json
import os
import sys
import threading
import time
import weakref
from pathlib import Path
from typing import Any

from jaxglider.core.toml import reason
from jaxglider.files.writing import replacing

PATIENCE, MINUTE = 5.0, 60.0
"""Time [s] after which a line says how long it has been there, and between lines where
standard error is no terminal."""


class Progress:
    """One line that is written over; where standard error is no terminal, one a minute.

    A thread goes on telling how long the same line has been there, so that a compiler
    that is busy for minutes is not taken for one that hangs.
    """

    def __init__(self) -> None:
        self._shown = 0
        self._live = sys.stderr.isatty()
        self._text, self._since = "", 0.0
        self._lock = threading.Lock()
        self._over: threading.Event | None = None

    def show(self, text: str, at: int | None = None, total: int | None = None) -> None:
        """Replace the line.

        Args:
            text: line to show.
            at: amount of work done, for a bar; the line says it itself.
            total: amount of work in all.
        """
        with self._lock:
            self._text, self._since = text, time.monotonic()
            if self._live:
                self._write(text)
            if self._over is None:
                self._over = threading.Event()
                about = weakref.ref(self), self._over, 1.0 if self._live else MINUTE
                threading.Thread(target=_watch, args=about, daemon=True).start()

    def clear(self) -> None:
        """Remove the line."""
        with self._lock:
            if self._over is not None:
                self._over.set()
                self._over = None
            if self._live and self._shown:
                sys.stderr.write("\r" + " " * self._shown + "\r")
                sys.stderr.flush()
                self._shown = 0

    def say_again(self, over: threading.Event) -> None:
        """Say again what is shown, and how long it has been there.

        Args:
            over: event that is set once nothing is shown any more.
        """
        with self._lock:
            lasted, text = time.monotonic() - self._since, self._text
            if over.is_set():
                return
            if lasted >= PATIENCE:
                text = f"{text} {lasted:.0f} s"
            if not self._live:
                note(text)
            elif lasted >= PATIENCE:
                self._write(text)

    def _write(self, text: str) -> None:
        sys.stderr.write("\r" + text.ljust(self._shown))
        sys.stderr.flush()
        self._shown = len(text)


def _watch(shown: "weakref.ref[Progress]", over: threading.Event, every: float) -> None:
    """Say again now and then what is shown, until it is over or nobody has the line."""
    while not over.wait(every):
        progress = shown()
        if progress is None:
            return
        progress.say_again(over)
        del progress


class SilentProgress(Progress):
    """Shows nothing."""

    def show(self, text: str, at: int | None = None, total: int | None = None) -> None:
        """Show nothing."""

    def clear(self) -> None:
        """Remove nothing."""


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
            if self._bar is not None:
                self._bar.close()
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
