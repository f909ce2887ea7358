"""Sets of gains: words and files of a command, turned into controllers."""

import dataclasses
import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError, file_text, read_toml
from jaxglider.files.gains import LoadedGains, decode_gains
from jaxglider.paper.tuned import tuned_gains

PAPER, TUNED, MISSION = "paper", "tuned", "mission"
"""The words for the paper's own gains, for those that come with jaxglider, and for
those of a mission file."""


@dataclasses.dataclass(frozen=True)
class Gains:
    """A set of gains and what it is called.

    Attributes:
        label: label for tables and files; unique among those of one command.
        origin: the word or file that it came from.
        text: text of a gains file; what it leaves out has the paper's value.
    """

    label: str
    origin: str
    text: str

    def load(self, scenario: str, model: Any) -> LoadedGains:
        """The controller that the text describes.

        Args:
            scenario: `switching` or `waypoints`, for what the file leaves out.
            model: design model.

        Raises:
            ConfigError: names the file, the key, the rule and the value.
        """
        try:
            return decode_gains(tomllib.loads(self.text), scenario, model)
        except ConfigError as error:
            raise ConfigError(f"{self.origin}: {error}") from error


def resolve(
    words: Sequence[str],
    controllers: Sequence[str],
    scenario: str,
    plant: str,
    own: Gains | None = None,
) -> tuple[Gains, ...]:
    """The sets of gains that words and file names stand for, in their order.

    Args:
        words: `paper`, `tuned`, `mission`, or the path of a gains file; what is named
            twice counts once.
        controllers: kinds that the words stand for.
        scenario: `switching` or `waypoints`; which gains `tuned` stands for.
        plant: name of the plant.
        own: set of gains that `mission` stands for, where there is one.

    Raises:
        ValueError: a file cannot be read or holds no gains, or none come with
            jaxglider for this case.
    """
    found = []
    names = list(dict.fromkeys(words))
    stems = [Path(name).stem for name in names]
    for name in names:
        if name == PAPER:
            found += [_paper(kind) for kind in dict.fromkeys(controllers)]
            continue
        if name == MISSION and own is not None:
            found.append(own)
            continue
        path = Path(name)
        if name == MISSION and not path.exists():
            raise ConfigError(f"--gains {MISSION} goes with --config FILE.")
        if name == TUNED and not path.exists():
            found += [
                Gains(
                    f"{kind} ({TUNED})",
                    TUNED,
                    tuned_gains(scenario, plant, kind).read_text(encoding="utf-8"),
                )
                for kind in dict.fromkeys(controllers)
            ]
            continue
        kind = _kind(path, read_toml(path))
        # `tune` gives all its files one name: tell them apart by their folder.
        short = path.stem if stems.count(path.stem) == 1 else name
        found.append(Gains(f"{kind} ({short})", name, file_text(path)))
    return told_apart(found)


def told_apart(sets: Sequence[Gains]) -> tuple[Gains, ...]:
    """Sets of gains under labels that differ, each file once however it is spelt.

    Raises:
        ConfigError: two that are not the same cannot be told apart.
    """
    files: dict[str, Gains] = {}
    for number, one in enumerate(sets):
        path = Path(one.origin)
        place = os.path.realpath(path) if path.is_file() else f"{number} {one.label}"
        files.setdefault(place, one)
    labels = [one.label for one in files.values()]
    apart = [
        dataclasses.replace(one, label=f"{one.label.partition(' (')[0]} ({one.origin})")
        if labels.count(one.label) > 1 and Path(one.origin).is_file()
        else one
        for one in files.values()
    ]
    labels = [one.label for one in apart]
    for one in apart:
        if labels.count(one.label) > 1:
            raise ConfigError(
                f"--gains: {one.label!r} would stand for two sets of gains; received "
                f"{', '.join(x.origin for x in apart)}. Rename a file."
            )
    return tuple(apart)


def _paper(kind: str) -> Gains:
    return Gains(kind, PAPER, f'[controller]\ntype = "{kind}"\n')


def _kind(path: Path, data: dict[str, Any]) -> str:
    try:
        return str(data["controller"]["type"])
    except (KeyError, TypeError):
        raise ConfigError(
            f"{path}: controller.type is missing: no gains file. `jaxglider tune` "
            "writes one."
        ) from None
