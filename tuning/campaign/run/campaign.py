"""Definition of a campaign: every row follows from this, and from nothing else.

It is kept beside the rows, whole files and all, so that a campaign can be gone on with,
joined or run again where the files it was made from are gone or changed.
"""

import dataclasses
import hashlib
import json
import tomllib
from collections.abc import Sequence
from typing import Any

from jaxglider.core.toml import ConfigError
from jaxglider.files.mission import build_mission
from jaxglider.files.uncertainty import build_uncertainty
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.members import Uncertainty
from jaxglider.uncertainty.quantities import uniform_uncertainty
from jaxglider.uncertainty.sampling import (
    AbstractSampler,
    LatinHypercube,
    MonteCarlo,
    SobolSequence,
)
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import GainSet
from tuning.problem.members import SWEEP


@dataclasses.dataclass(frozen=True)
class CampaignSettings:
    """A campaign as told on the command line, files included.

    Attributes:
        scenario: `switching`, `waypoints`, or the mission's name.
        plant: name of the plant.
        dt: control tick [s]; None for the case's own.
        duration: horizon [s]; None for the case's own.
        precision: bits of a number in the rollouts, 32 or 64.
        seed: seed of the members.
        members: number of members over all shards; the most there can be with
            `--until-ci`.
        design: name of the sampler: `monte-carlo`, `latin-hypercube` or `sobol`.
        uncertainty: a half width for all, or the text of an uncertainty file.
        gains: sets of gains that are compared, in order.
        until_ci: width of the interval at which to stop, or None.
        mission: the tables of a mission file, files that it names included, or None
            for a case of the paper.
        actuators: `vehicle`, `ideal`, or None for those of the plant.
        digest: fingerprint of loops and uncertainty that were handed over from Python,
            which no file can tell; empty otherwise.
    """

    scenario: str
    plant: str
    dt: float | None
    duration: float | None
    precision: int
    seed: int
    members: int
    design: str
    uncertainty: float | str
    gains: tuple[GainSet, ...]
    until_ci: float | None = None
    mission: dict[str, Any] | None = None
    actuators: str | None = None
    digest: str = ""

    def __post_init__(self) -> None:
        # What is kept beside the rows needs no other file.
        gains = tuple(gains.self_contained() for gains in self.gains)
        object.__setattr__(self, "gains", gains)

    def case(self) -> FlightCase:
        """The case that is flown."""
        if self.mission is not None:
            return FlightCase.of_mission(build_mission(self.mission), self.duration)
        return FlightCase.of_paper(
            self.scenario, self.plant, self.dt, self.duration, self.actuators
        )

    @property
    def vehicle(self) -> str:
        """Name of the vehicle; empty where loops were given."""
        return "" if self.digest else self.case().vehicle

    def fingerprint(self) -> str:
        """A digest of everything that the rows depend on."""
        return fingerprint_of(dataclasses.asdict(self))

    def differences(self, other: "CampaignSettings") -> list[str]:
        """Names of the settings that differ in what they say.

        Files count by their keys and values: where they lie, how they are spelt on the
        command line, their comments and what made them say nothing of the rows.
        """
        own, others = self._content(), other._content()
        return [name for name, value in own.items() if value != others[name]]

    def _content(self) -> dict[str, Any]:
        table = dataclasses.asdict(self)
        table["uncertainty"] = _parsed(self.uncertainty)
        names = ("label", "origin")
        table["gains"] = [
            {key: _parsed(value) for key, value in entry.items() if key not in names}
            for entry in table["gains"]
        ]
        return table

    @classmethod
    def of(cls, table: dict[str, Any]) -> "CampaignSettings":
        """Settings from what `dataclasses.asdict` made of them."""
        gains = tuple(GainSet.of(entry) for entry in table["gains"])
        return cls(**{**table, "gains": gains})


def fingerprint_of(table: dict[str, Any]) -> str:
    """A digest of settings as `campaign.json` holds them, of whatever version."""
    if not table.get("digest"):
        # As it was before campaigns could be made from Python.
        table = {key: value for key, value in table.items() if key != "digest"}
    text = json.dumps(table, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _parsed(content: Any) -> Any:
    """Tables of a file's text, without those that say where it comes from."""
    if isinstance(content, str):
        try:
            content = tomllib.loads(content)
        except tomllib.TOMLDecodeError:
            return content
    if isinstance(content, dict):
        return {key: value for key, value in content.items() if key != "provenance"}
    return content


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A campaign put together.

    Attributes:
        settings: settings it follows from.
        uncertainty: quantities that differ from member to member.
        design: sampler of the members' places in the unit cube.
        loops: closed loops, one for each set of gains, all in the nominal scenario.
        kinds: kinds of their controllers.
        stream: stream of the members' keys; another stream has other members.
    """

    settings: CampaignSettings
    uncertainty: Uncertainty
    design: AbstractSampler
    loops: tuple[ClosedLoop, ...]
    kinds: tuple[str, ...]
    stream: int = SWEEP

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the sets of gains."""
        return tuple(gains.label for gains in self.settings.gains)

    @property
    def has_flight(self) -> bool:
        """Whether yos are flown."""
        return self.uncertainty.scenario.reference.phased

    @property
    def waypoints(self) -> int | None:
        """Number of waypoints of the course, or None where there is no course."""
        return self.uncertainty.scenario.reference.waypoints


def build(settings: CampaignSettings) -> Campaign:
    """Put a campaign together.

    Raises:
        ValueError: a number, an uncertainty or a set of gains cannot be used.
    """
    if settings.digest:
        raise ValueError(
            "this campaign was made from Python, and its closed loops are in no file; "
            "go on with it by tuning.sweep(..., out=FOLDER, resume=True)."
        )
    case = settings.case()
    uncertainty = _uncertainty(settings.uncertainty, case.scenario)
    case = dataclasses.replace(case, scenario=uncertainty.scenario)
    kinds, loops = zip(*(case.loop(gains) for gains in settings.gains), strict=True)
    return Campaign(
        settings=settings,
        uncertainty=uncertainty,
        design=make_sampler(settings, uncertainty.names()),
        loops=loops,
        kinds=kinds,
    )


def _uncertainty(level: float | str, scenario: Scenario) -> Uncertainty:
    if isinstance(level, str):
        try:
            return build_uncertainty(tomllib.loads(level), scenario)
        except (ConfigError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"--uncertainty: {error}") from error
    if level == 0.0:
        raise ConfigError(
            "--uncertainty must be above zero for a sweep; received 0. For the nominal "
            "run alone use `jaxglider compare`."
        )
    return uniform_uncertainty(scenario, level, level)


def make_sampler(settings: CampaignSettings, names: Sequence[str]) -> AbstractSampler:
    """The sampler of the members' places in the unit cube."""
    if settings.design == "latin-hypercube":
        return LatinHypercube(settings.seed, len(names), settings.members)
    if settings.design == "sobol":
        return SobolSequence(settings.seed, len(names))
    return MonteCarlo(settings.seed, tuple(names), SWEEP)
