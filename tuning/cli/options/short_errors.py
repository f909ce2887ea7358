"""A parser whose complaints are short and name what was nearly written."""

import argparse
import difflib
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

_GLIDER = ("--vehicle", "--plant")
GLIDER = (
    ": the glider is the mission's, in its table [vehicle]; `jaxglider init --vehicle "
    "NAME` writes a mission for another one"
)
"""Advice where a command has no option for the glider."""
_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")


class Parser(argparse.ArgumentParser):
    """A parser of a command that says its own usage in one line, and what is near."""

    def error(self, message: str) -> NoReturn:
        """One line of usage and the complaint, then exit code 2."""
        choice = _CHOICE.search(message)
        if choice:
            names = re.findall(r"[^\s,']+", choice[2])
            message += nearest(choice[1], names)
        sys.stderr.write(
            f"usage: {self.prog} [options]; `{self.prog} --help` lists them\n"
            f"{self.prog}: error: {message}\n"
        )
        sys.exit(2)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """The options; what is none of this command's is refused here, not above."""
        names = [name for one in self._actions for name in one.option_strings]
        for word in args or () if self._subparsers is None else ():
            name = word.partition("=")[0]
            # Before its value is taken for a mission.
            if name in _GLIDER and name not in names:
                self.error(f"unrecognized argument {name}{GLIDER}")
        options, rest = super().parse_known_args(args, namespace)
        if rest:
            near = nearest(rest[0].partition("=")[0], names)
            self.error(f"unrecognized arguments: {' '.join(rest)}{near}")
        return options, rest


def nearest(word: str, names: Iterable[str]) -> str:
    """A question whether a name was meant that is nearly the word; empty for none.

    Args:
        word: word that was written.
        names: names that would have been right.
    """
    near = difflib.get_close_matches(word, list(names), 1)
    return f"; did you mean {near[0]}?" if near else ""


class Mission(argparse.Action):
    """Keeps a mission file, named alone or by --config; two that differ are refused."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Keep the path.

        Raises:
            argparse.ArgumentError: another one has been named.
        """
        before = getattr(namespace, self.dest, None)
        if values is None:
            return
        if before not in (None, values):
            raise argparse.ArgumentError(
                self, f"names {values}, but the mission is {before} already; name one."
            )
        setattr(namespace, self.dest, values)
