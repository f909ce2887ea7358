"""The task that gains are for: one of the paper's cases, or a mission file."""

import dataclasses
from collections.abc import Sequence

from jaxglider import paper
from jaxglider.files.course_remarks import paper_case
from jaxglider.files.mission import Mission
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.gains import LoadedGains
from jaxglider.simulation.scenario import Clock, Scenario
from jaxglider.simulation.specification import Specification
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.published import load_vehicle
from tuning.problem.gain_sets import MISSION, GainSet, resolve
from tuning.reporting.tables import headline

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
        scenario: scenario with the specification that all laws are judged by, whatever
            becomes of their own funnels.
        model: design model.
        own: gains of the mission file, or None.
        vehicle: name of the vehicle; empty where a loop was given.
    """

    title: str
    kind: str
    plant: str
    scenario: Scenario
    model: DesignModel
    own: GainSet | None = None
    vehicle: str = ""

    @property
    def headline(self) -> str:
        """Title of what is flown: case, vehicle and plant."""
        return headline(self.title, self.vehicle, self.plant)

    @classmethod
    def of_paper(
        cls,
        kind: str,
        plant: str,
        dt: float | None,
        duration: float | None,
        actuators: str | None = None,
    ) -> "FlightCase":
        """One of the paper's cases.

        Args:
            kind: `switching` or `waypoints`.
            plant: name of the plant.
            dt: control tick [s]; 0.05 by default.
            duration: horizon [s]; the case's own by default.
            actuators: `vehicle`, `ideal`, or None for those of the plant.

        Raises:
            ValueError: a number is out of range.
        """
        scenario = paper.make_scenario(
            kind, plant, dt=dt or DT, duration=duration, actuators=actuators
        )
        model = paper.design_model(scenario.plant)
        vehicle = load_vehicle(paper.VEHICLE).name
        return cls(kind, kind, plant, scenario, model, vehicle=vehicle)

    @classmethod
    def of_mission(
        cls, mission: Mission, duration: float | None = None
    ) -> "FlightCase":
        """The task of a mission, judged by its specification.

        Args:
            mission: mission from a file.
            duration: another horizon [s].

        Raises:
            ValueError: the duration is out of range.
        """
        scenario = mission.loop.scenario
        if duration is not None:
            clock = scenario.clock
            longer = Clock.lasting(duration, float(clock.dt), clock.substeps)
            clock = dataclasses.replace(longer, moving=clock.moving)
            scenario = dataclasses.replace(scenario, clock=clock)
        return cls(
            mission.name,
            paper_case(scenario.reference.waypoints is not None),
            mission.plant,
            scenario,
            mission.model,
            GainSet(f"{mission.controller} ({MISSION})", MISSION, mission.law),
            mission.vehicle,
        )

    @classmethod
    def of_loop(cls, loop: ClosedLoop, title: str) -> "FlightCase":
        """The scenario of a closed loop, judged by its specification.

        One without is judged by what the paper's case prescribes: its controller's own
        funnel would change with its gains.

        Args:
            loop: closed loop to take the scenario and the design model from.
            title: name of what is flown, for reports.
        """
        scenario = loop.scenario
        case = paper_case(scenario.reference.waypoints is not None)
        if scenario.specification is None:
            prescribed = paper.specification(case, scenario.plant)
            scenario = dataclasses.replace(scenario, specification=prescribed)
        model = loop.controller.model
        if model is None:
            model = paper.design_model(scenario.plant)
        return cls(title, case, type(scenario.plant).__name__, scenario, model)

    @property
    def specification(self) -> Specification:
        """The specification that is judged by."""
        prescribed = self.scenario.specification
        return prescribed or paper.specification(self.kind, self.scenario.plant)

    def resolve(
        self, words: Sequence[str], controllers: Sequence[str]
    ) -> tuple[GainSet, ...]:
        """The sets of gains that words and file names stand for here."""
        mission = "" if self.own is None else self.title
        return resolve(
            words, controllers, self.kind, self.plant, self.own, mission=mission
        )

    def loop(self, gains: GainSet) -> tuple[str, ClosedLoop]:
        """The kind of controller of a set of gains, and the closed loop with it."""
        law = gains.load(self.kind, self.model, self.specification.funnel)
        if law.estimator is None and self.own is not None:
            # Laws differ by what they say, not by what they know.
            mine = self.own.content
            if isinstance(mine, LoadedGains):
                law = law._replace(estimator=mine.estimator)
        return law.kind, law.on(self.scenario)
