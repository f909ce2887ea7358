"""Sets of gains: words and files of a command, turned into controllers."""

import dataclasses
import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxglider.control import Funnel
from jaxglider.core.toml import ConfigError, read_toml
from jaxglider.files.gains import (
    LoadedGains,
    decode_gains,
    encode_gains,
    read_gains,
    with_law_inside,
)
from jaxglider.files.law_paths import is_own, short_name
from jaxglider.files.user_law import law_entry
from jaxglider.paper.tuned import has_tuned_gains, tuned_gains
from jaxglider.vehicle.design_model import DesignModel

PAPER, TUNED, MISSION = "paper", "tuned", "mission"
"""The words for the gains that a law begins with (the paper's), for those that come
with jaxglider, and for those of a mission file."""

Tables = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class GainSet:
    """A set of gains and what it is called.

    Attributes:
        label: name for tables and files; unique among those of one command.
        origin: word or file that it came from.
        content: tables of a gains file, where what is left out has the value that the
            law begins with; or the law itself.
    """

    label: str
    origin: str
    content: Tables | LoadedGains

    def load(
        self, scenario: str, model: DesignModel, funnel: Funnel | None = None
    ) -> LoadedGains:
        """The law with these gains.

        Args:
            scenario: `switching` or `waypoints`, for what the tables leave out.
            model: design model.
            funnel: funnel that a law of one's own begins with; the paper's by default.

        Raises:
            ConfigError: names the file, the key, the rule and the value.
        """
        if isinstance(self.content, LoadedGains):
            return self.content
        try:
            return decode_gains(self.content, scenario, model, funnel)
        except ConfigError as error:
            where = f"{self.origin}: " if is_file(self.origin) else ""
            raise ConfigError(f"{where}{error}") from error

    def self_contained(self) -> "GainSet":
        """The same as tables that need no file, not even that of a law of one's own.

        Raises:
            ConfigError: the file of such a law cannot be read.
        """
        tables = self.content
        if isinstance(tables, LoadedGains):
            law = tables
            tables = encode_gains(
                law.controller, law.observer, law.guidance, law.estimator
            )
        # Where gains come from changes nothing that they do.
        tables = {key: x for key, x in tables.items() if key != "provenance"}
        try:
            return dataclasses.replace(self, content=with_law_inside(tables))
        except ConfigError as error:
            where = f"{self.origin}: " if is_file(self.origin) else ""
            raise ConfigError(f"{where}{error}") from error

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> "GainSet":
        """A set from what `dataclasses.asdict` made of a self-contained one.

        What older versions made of it has the text of a gains file for its content.
        """
        content = entry["content"] if "content" in entry else entry["text"]
        if isinstance(content, str):
            content = tomllib.loads(content)
        return cls(entry["label"], entry["origin"], content)


def is_file(word: str) -> bool:
    """Whether a word names a file: it ends in .toml or has a separator of a path."""
    separators = tuple(s for s in (os.sep, os.altsep) if s)
    return word.endswith(".toml") or any(s in word for s in separators)


def read_files(words: Sequence[str]) -> dict[str, Tables]:
    """The tables of all gains files among some words, by word; each is read once.

    Raises:
        ConfigError: a file cannot be read or holds no gains.
    """
    files = {word: read_gains(word) for word in dict.fromkeys(words) if is_file(word)}
    for word, tables in files.items():
        controller = tables.get("controller")
        if not isinstance(controller, dict) or "type" not in controller:
            raise ConfigError(
                f"{word}: controller.type is missing: no gains file. `jaxglider tune` "
                "writes one."
            )
    return files


def resolve(
    words: Sequence[str],
    controllers: Sequence[str],
    scenario: str,
    plant: str,
    own: GainSet | None = None,
    files: Mapping[str, Tables] | None = None,
    mission: str = "",
) -> tuple[GainSet, ...]:
    """The sets of gains that words and file names stand for, in their order.

    Args:
        words: `paper`, `tuned`, `mission`, or the path of a gains file, which ends in
            .toml or has a separator; what is named twice counts once.
        controllers: laws that the words stand for, by their names in the catalogue or
            as FILE.py:ClassName.
        scenario: `switching` or `waypoints`; which gains `tuned` stands for.
        plant: name of the plant; likewise.
        own: set of gains that `mission` stands for, or None.
        files: tables from `read_files`, where they have been read already.
        mission: name of a mission, whose gains `tuned` stands for where any come along.

    Raises:
        ValueError: a word that is none of these, a file that cannot be read or holds
            no gains, or no gains come with jaxglider for this case.
    """
    names = list(dict.fromkeys(words))
    tables = read_files(names) if files is None else files
    stems = [Path(name).stem for name in tables]
    kinds = list(dict.fromkeys(controllers))
    sets: list[GainSet] = []
    for name in names:
        if name == PAPER:
            sets += [_beginning(kind) for kind in kinds]
        elif name == TUNED:
            sets += [_tuned(kind, scenario, plant, mission) for kind in kinds]
        elif name in tables:
            # `tune` gives all its files one name: tell them apart by their folder.
            stem = Path(name).stem
            short = stem if stems.count(stem) == 1 else name
            kind = short_name(str(tables[name]["controller"]["type"]))
            sets.append(GainSet(f"{kind} ({short})", name, tables[name]))
        elif name != MISSION:
            raise ConfigError(
                f"--gains must be {PAPER}, {TUNED}, {MISSION} or a file, whose path "
                f"ends in .toml or has a {os.sep!r} in it; received {name!r}."
            )
        elif own is None:
            raise ConfigError(f"--gains {MISSION} goes with --config FILE.")
        else:
            sets.append(own)
    return told_apart(sets)


def told_apart(sets: Sequence[GainSet]) -> tuple[GainSet, ...]:
    """Sets of gains under labels that differ, each file once however it is spelt.

    Raises:
        ConfigError: two that are not the same cannot be told apart.
    """
    files: dict[str, GainSet] = {}
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


def _beginning(kind: str) -> GainSet:
    """The gains that a law begins with, the paper's where it has any."""
    law_entry(kind, "--controller")
    return GainSet(short_name(kind), PAPER, {"controller": {"type": kind}})


def _tuned(kind: str, scenario: str, plant: str, mission: str) -> GainSet:
    if is_own(kind):
        raise ConfigError(
            f"--gains {TUNED}: no gains come with jaxglider for {kind}; name the file "
            f"that `jaxglider tune` wrote, or {PAPER} for those it begins with."
        )
    own = has_tuned_gains(mission, plant, kind)
    file = tuned_gains(mission if own else scenario, plant, kind)
    return GainSet(f"{kind} ({TUNED})", TUNED, read_toml(file))
