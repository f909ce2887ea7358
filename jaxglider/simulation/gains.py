"""A law, its observer, estimator and guidance with all gains, not yet in a scenario."""

import dataclasses
from typing import NamedTuple

from jaxglider.control.controller import AbstractController
from jaxglider.control.observer import AbstractObserver
from jaxglider.guidance import LineOfSight
from jaxglider.guidance.routes import guided_by
from jaxglider.navigation.catalogue import DEFAULT, make_estimator
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario


class LoadedGains(NamedTuple):
    """A law, its observer and its guidance with their gains, from wherever they come.

    Attributes:
        kind: name of the law: in the catalogue, or FILE.py:ClassName.
        controller: the law with its gains.
        observer: the disturbance observer with its gains.
        guidance: gains of the line of sight, or None to keep those of the scenario.
        estimator: estimator with its gains, of use where a scenario has instruments;
            None for the one that is made for them.
    """

    kind: str
    controller: AbstractController
    observer: AbstractObserver
    guidance: LineOfSight | None = None
    estimator: AbstractEstimator | None = None

    def on(self, scenario: Scenario) -> ClosedLoop:
        """The closed loop that steers a scenario with these gains.

        Guidance that is given replaces that of a waypoint path; a schedule has none,
        and keeps its headings.

        Raises:
            ValueError: the scenario has instruments, and the law no design model for an
                estimator.
        """
        if self.guidance is not None:
            path = guided_by(scenario.reference, self.guidance)
            scenario = dataclasses.replace(scenario, reference=path)
        estimator = self._estimator(scenario)
        law = self.controller.paced(scenario.clock.dt)
        return ClosedLoop(scenario, law, self.observer, estimator)

    def _estimator(self, scenario: Scenario) -> AbstractEstimator | None:
        """The estimator for the instruments and the clock; None without instruments."""
        instruments, steps = scenario.instruments, scenario.clock.substeps
        if instruments is None:
            return None
        if self.estimator is not None:
            return self.estimator.stepped(steps)
        model = self.controller.model
        if model is None:
            raise ValueError(
                f"{self.kind} has no design model, which the estimator of a mission "
                "with sensors is made of. Give the law a field `model`."
            )
        return make_estimator(DEFAULT, model, instruments, steps)
