"""A tuning problem as a value: case, gains, free numbers, members, objective."""

import dataclasses
import math
from typing import Any

from jaxglider.control import AbstractController
from jaxglider.core.kept.fingerprint import fingerprint
from jaxglider.files.codec import FAMILIES
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Clock
from jaxglider.uncertainty.members import Uncertainty
from jaxglider.uncertainty.quantities import uniform_uncertainty
from tuning.problem.aggregates import MEAN, AbstractAggregate
from tuning.problem.arguments import closed_loop, half_width, real, whole
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import PAPER
from tuning.problem.objective import Cost, Weights
from tuning.problem.objective_file import DEFAULT_WEIGHTS
from tuning.space.coordinates import tunable_paths
from tuning.space.space import HELD_BY_DEFAULT


def name_of(controller: AbstractController) -> str:
    """The name of a control law, or that of its class for one of the user's own."""
    names = {cls: name for name, cls in FAMILIES[AbstractController].items()}
    return names.get(type(controller), type(controller).__name__)


DEFAULT_UNCERTAINTY = 0.2
"""Relative half width of masses, inertias, coefficients and waves."""


@dataclasses.dataclass(frozen=True)
class EnsembleSpec:
    """The members of a tuning problem.

    Attributes:
        uncertainty: quantities that differ between members, and how; or one relative
            half width in [0, 1) for masses, inertias, coefficients and waves.
        training: number of members to descend on; 1 is the nominal case alone.
        validation: number of members that the best step is chosen by.
        test: number of members held out for the verdict.
        seed: seed of all members, in [0, 2³²).

    Raises:
        ValueError: a number is out of its range.
    """

    uncertainty: Uncertainty | float = DEFAULT_UNCERTAINTY
    training: int = 32
    validation: int = 32
    test: int = 64
    seed: int = 0

    def __post_init__(self) -> None:
        half_width(self.uncertainty, zero=True)
        for name in ("training", "validation", "test"):
            whole(name, getattr(self, name))
        whole("seed", self.seed, 0, 2**32)

    @classmethod
    def nominal(cls) -> "EnsembleSpec":
        """The nominal case alone, for all three sets."""
        return cls(uncertainty=0.0, training=1, validation=1, test=1)

    def on(self, loop: ClosedLoop) -> Uncertainty:
        """The uncertainty of members that fly the scenario of a closed loop.

        Raises:
            ValueError: the half width is out of its range.
        """
        if isinstance(self.uncertainty, Uncertainty):
            return self.uncertainty
        half = float(self.uncertainty)
        return uniform_uncertainty(loop.scenario, half, half)


@dataclasses.dataclass(frozen=True)
class ProblemSpec:
    """A tuning problem as a value: everything that its result follows from.

    Attributes:
        case: vehicle, sea and reference that are flown.
        controller: name of the control law.
        loop: closed loop with the gains to start from, in the scenario of the case.
        free: dotted paths of what is tuned, `*` for any component; empty for all
            numbers of the law and its observer.
        ensemble: members to tune on, to choose by and to judge by.
        weights: weight of each term of the objective.
        cost: cost function of the user's own, taken instead of the weighted terms; see
            `load_cost`.
        aggregate: mean, CVaR or soft worst of the members' costs.
        constraints: names of the coupled constraints that are held; each gain's own
            set is always held.
        disturbance_rate_bound: bounds on the rate of each axis' disturbance [N/s, N
            m/s], for the constraint `observer-set`.
        gradient_memory: memory of the gradient that is descended [s], positive; None
            for the exact one. See `evaluate`.

    Raises:
        ValueError: the memory is out of its range.
    """

    case: FlightCase
    controller: str
    loop: ClosedLoop
    free: tuple[str, ...] = ()
    ensemble: EnsembleSpec = EnsembleSpec()
    weights: Weights = DEFAULT_WEIGHTS
    cost: Cost | None = None
    aggregate: AbstractAggregate = MEAN
    constraints: tuple[str, ...] = HELD_BY_DEFAULT
    disturbance_rate_bound: BodyAxes[float] | None = None
    gradient_memory: float | None = 150.0

    def __post_init__(self) -> None:
        if self.gradient_memory is not None:
            memory = self.gradient_memory
            real("gradient_memory", memory, 0.0, math.inf, "a positive number or None")

    @classmethod
    def of_loop(
        cls, loop: ClosedLoop, title: str = "own", **more: Any
    ) -> "ProblemSpec":
        """The problem of tuning a closed loop in its own scenario.

        Args:
            loop: closed loop with the gains to start from; any controller.
            title: name of what is flown, for reports.
            **more: further attributes.

        Raises:
            ValueError: the loop has no controller that can be tuned.
        """
        closed_loop("loop", loop)
        if not isinstance(loop.controller, AbstractController):
            raise ValueError(
                "loop.controller must be an AbstractController; received "
                f"{type(loop.controller).__name__}."
            )
        case = FlightCase.of_loop(loop, title)
        judged = dataclasses.replace(loop, scenario=case.scenario)
        return cls(case, name_of(loop.controller), judged, **more)

    @classmethod
    def of_paper(
        cls,
        scenario: str,
        plant: str,
        controller: str,
        *,
        gains: str = PAPER,
        dt: float | None = None,
        duration: float | None = None,
        actuators: str | None = None,
        **more: Any,
    ) -> "ProblemSpec":
        """The problem of tuning a control law in one of the paper's cases.

        Args:
            scenario: `switching` or `waypoints`.
            plant: name of the plant.
            controller: name of the control law.
            gains: gains to start from: `paper`, `tuned` or the path of a file.
            dt: control tick [s]; the case's own by default.
            duration: horizon [s]; the case's own by default.
            actuators: `vehicle`, `ideal`, or None for those of the plant.
            **more: further attributes.

        Raises:
            ValueError: a name is unknown, a number out of range, or a file unusable.
        """
        case = FlightCase.of_paper(scenario, plant, dt, duration, actuators)
        (chosen,) = case.resolve([gains], [controller])
        name, loop = case.loop(chosen)
        return cls(case, name, loop, **more)

    def lasting(self, duration: float) -> "ProblemSpec":
        """The same problem on another horizon [s].

        Raises:
            ValueError: the duration is out of range.
        """
        clock = self.loop.scenario.clock
        clock = Clock.lasting(duration, float(clock.dt), clock.substeps)
        scenario = dataclasses.replace(self.case.scenario, clock=clock)
        timed = dataclasses.replace(self.loop.scenario, clock=clock)
        ensemble = self.ensemble
        if isinstance(ensemble.uncertainty, Uncertainty):
            uncertain = dataclasses.replace(ensemble.uncertainty, scenario=timed)
            ensemble = dataclasses.replace(ensemble, uncertainty=uncertain)
        return dataclasses.replace(
            self,
            case=dataclasses.replace(self.case, scenario=scenario),
            loop=dataclasses.replace(self.loop, scenario=timed),
            ensemble=ensemble,
        )

    @property
    def paths(self) -> tuple[str, ...]:
        """Dotted paths of what is tuned."""
        if self.free:
            return self.free
        known = {path.partition(".")[0] for path in tunable_paths(self.loop)}
        parts = ("controller", "observer", "estimator")
        return tuple(part for part in parts if part in known)

    def fingerprint(self) -> str:
        """A digest of everything that the result follows from."""
        return fingerprint(self)
