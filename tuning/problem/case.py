"""The task that gains are for: one of the paper's cases, or a mission file."""

import dataclasses
from collections.abc import Sequence

from jaxglider import paper
from jaxglider.files.mission import Mission, paper_case
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Clock, Scenario
from jaxglider.vehicle.design_model import DesignModel
from tuning.problem.gain_sets import MISSION, GainSet, resolve

DT = 0.05
"""Control tick where none is given [s]."""


@dataclasses.dataclass(frozen=True)
class FlightCase:
    """A task and what its controllers are designed with.

    Attributes:
        title: `switching`, `waypoints`, or the mission's name.
        kind: name of one of the paper's cases, whose gains and funnel stand in for what
            is left out.
        plant: name of the plant.
        scenario: scenario with the funnel that all laws are judged by, whatever becomes
            of their own.
        model: design model.
        own: gains of the mission file, or None.
    """

    title: str
    kind: str
    plant: str
    scenario: Scenario
    model: DesignModel
    own: GainSet | None = None

    @classmethod
    def of_paper(
        cls, kind: str, plant: str, dt: float | None, duration: float | None
    ) -> "FlightCase":
        """One of the paper's cases.

        Args:
            kind: `switching` or `waypoints`.
            plant: name of the plant.
            dt: control tick [s]; 0.05 by default.
            duration: horizon [s]; the case's own by default.

        Raises:
            ValueError: a number is out of range.
        """
        scenario = paper.make_scenario(kind, plant, dt=dt or DT, duration=duration)
        scenario = dataclasses.replace(scenario, funnel=paper.funnel(kind))
        return cls(kind, kind, plant, scenario, paper.design_model(scenario.plant))

    @classmethod
    def of_mission(
        cls, mission: Mission, duration: float | None = None
    ) -> "FlightCase":
        """The task of a mission, judged by its funnel or else its controller's.

        Args:
            mission: mission from a file.
            duration: another horizon [s].

        Raises:
            ValueError: the duration is out of range.
        """
        loop, scenario = mission.loop, mission.loop.scenario
        if duration is not None:
            clock = scenario.clock
            longer = Clock.lasting(duration, float(clock.dt), clock.substeps)
            clock = dataclasses.replace(longer, moving=clock.moving)
            scenario = dataclasses.replace(scenario, clock=clock)
        if scenario.funnel is None:
            scenario = dataclasses.replace(scenario, funnel=loop.controller.funnel)
        return cls(
            mission.name,
            paper_case(scenario.reference.waypoints is not None),
            mission.plant,
            scenario,
            mission.model,
            GainSet(f"{mission.controller} ({MISSION})", MISSION, mission.law),
        )

    @classmethod
    def of_loop(cls, loop: ClosedLoop, title: str) -> "FlightCase":
        """The scenario of a closed loop, judged by its funnel or its controller's.

        Args:
            loop: closed loop to take the scenario and the design model from.
            title: name of what is flown, for reports.
        """
        scenario = loop.scenario
        if scenario.funnel is None:
            scenario = dataclasses.replace(scenario, funnel=loop.controller.funnel)
        model = loop.controller.model
        if model is None:
            model = paper.design_model(scenario.plant)
        case = paper_case(scenario.reference.waypoints is not None)
        return cls(title, case, type(scenario.plant).__name__, scenario, model)

    def resolve(
        self, words: Sequence[str], controllers: Sequence[str]
    ) -> tuple[GainSet, ...]:
        """The sets of gains that words and file names stand for here."""
        return resolve(words, controllers, self.kind, self.plant, self.own)

    def loop(self, gains: GainSet) -> tuple[str, ClosedLoop]:
        """The kind of controller of a set of gains, and the closed loop with it."""
        law = gains.load(self.kind, self.model, self.scenario.funnel)
        return law.kind, law.on(self.scenario)
