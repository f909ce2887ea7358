"""Missions as arguments: a file, or a name of those that come with the package."""

import argparse
import importlib.util
from pathlib import Path

from tuning.cli.options.short_errors import Mission, nearest


def shipped_missions() -> dict[str, Path]:
    """Files of the missions of the package by their names; the package stays asleep."""
    return _shipped("files/flight/missions")


def _shipped(folder: str) -> dict[str, Path]:
    spec = importlib.util.find_spec("jaxglider")
    if spec is None or spec.origin is None:
        return {}
    place = Path(spec.origin).parent / folder
    return {path.stem: path for path in sorted(place.glob("*.toml"))}


def mission_file(text: str) -> Path:
    """A mission file, or that of a mission of the package where there is no such file.

    An existing file or folder of that name stands before it.

    Raises:
        argparse.ArgumentTypeError: it is neither, and nearly such a name.
    """
    path = Path(text)
    # What is no name may be the value of an option that is misspelt.
    known = {**shipped_missions(), **_shipped("vehicle/data")}
    if path.exists() or path.suffix or not nearest(text, known):
        return path
    return mission_name(text)


def mission_name(text: str) -> Path:
    """The file of a mission of the package.

    Raises:
        argparse.ArgumentTypeError: there is none of that name.
    """
    known = shipped_missions()
    if text not in known:
        hint = nearest(text, known)
        if text in _shipped("vehicle/data"):
            hint = (
                f", a glider: `jaxglider init --vehicle {text}` writes a mission for it"
            )
        raise argparse.ArgumentTypeError(
            f"must be one of {', '.join(known)}; received {text!r}{hint}"
        )
    return known[text]


def add_mission(parser: argparse.ArgumentParser, text: str) -> None:
    """A mission file, named alone or by `--config`.

    Args:
        parser: parser of the command.
        text: explanation of it.
    """
    parser.add_argument(
        "config",
        nargs="?",
        type=mission_file,
        action=Mission,
        metavar="MISSION",
        help="mission file, as --config FILE, or name, as --mission NAME",
    )
    parser.add_argument(
        "--mission",
        dest="config",
        type=mission_name,
        action=Mission,
        metavar="NAME",
        help="mission of the package (`jaxglider missions` lists them)",
    )
    parser.add_argument(
        "--config", type=Path, action=Mission, metavar="FILE", help=text
    )
