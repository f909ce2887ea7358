"""A law, its observer and guidance with all gains, not yet in a scenario."""

import dataclasses
from typing import NamedTuple

from jaxglider.control.controller import AbstractController
from jaxglider.control.observer import AbstractObserver
from jaxglider.guidance import LineOfSight
from jaxglider.guidance.routes import guided_by
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario


class LoadedGains(NamedTuple):
    """A law, its observer and its guidance with their gains, from wherever they come.

    Attributes:
        kind: name of the law: in the catalogue, or FILE.py:ClassName.
        controller: the law with its gains.
        observer: the disturbance observer with its gains.
        guidance: gains of the line of sight, or None to keep those of the scenario.
    """

    kind: str
    controller: AbstractController
    observer: AbstractObserver
    guidance: LineOfSight | None = None

    def on(self, scenario: Scenario) -> ClosedLoop:
        """The closed loop that steers a scenario with these gains.

        Guidance that is given replaces that of a waypoint path; a schedule has none,
        and keeps its headings.
        """
        if self.guidance is not None:
            path = guided_by(scenario.reference, self.guidance)
            scenario = dataclasses.replace(scenario, reference=path)
        return ClosedLoop(scenario, self.controller, self.observer)
