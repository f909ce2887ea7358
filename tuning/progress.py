"""Progress on standard error, where somebody is looking."""

import sys


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
