"""A tuning task put together: the closed loop, its free numbers, members, objective."""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import evaluate, sparse_checkpoints
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.members import Member, Uncertainty, with_member
from jaxglider.uncertainty.quantities import uniform_uncertainty
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import MISSION, PAPER
from tuning.problem.lanes import losses, member_count
from tuning.problem.members import (
    TEST,
    TRAINING,
    VALIDATION,
    nominal_member,
    sample_members,
)
from tuning.problem.objective import Aggregate, Objective
from tuning.problem.objective_file import load_cost, read_objective
from tuning.space.space import Space

DEFAULT_FREE = {
    "fxtppc": ("controller", "observer"),
    "fxtppc-roll": ("controller", "observer"),
    "ppc": ("controller", "observer"),
    "smc": ("controller",),
}
"""Which numbers are tuned where the user does not say: all of the law's own."""

DEFAULT_CONTROLLER = {
    "printed": "fxtppc",
    "rigid-body": "fxtppc-roll",
    "seawing": "fxtppc-roll",
}
"""What is tuned where neither option nor file says; the printed glider rolls away from
its mass, and needs no more than the paper's law."""


GRADIENT_MEMORY = 60.0
"""How long the gradient that is descended remembers [s]; see `rollout.evaluate`."""

STATE_SIZE, STATES_LIMIT = 50, 2**30
"""Numbers that a gradient keeps of a tick of one member; and bytes it may keep."""


@dataclasses.dataclass(frozen=True)
class TuningProblem:
    """Everything a tuning run needs.

    Attributes:
        case: what is flown.
        kind: of the controller.
        loop: the closed loop with the gains as given.
        space: which numbers are free.
        objective: the cost of one rollout.
        aggregate: how members' costs become one.
        training: members to descend on.
        validation: members to choose by.
        test: members for the verdict alone.
        unit: what a run like the start costs; see `Objective.unit`.
        gradient_memory: of the gradient that is descended [s]; None for the exact one.
    """

    case: FlightCase
    kind: str
    loop: ClosedLoop
    space: Space
    objective: Objective
    aggregate: Aggregate
    training: Member
    validation: Member
    test: Member
    unit: float
    gradient_memory: float | None = None

    def loss(self, free: Any, member: Member) -> Any:
        """The objective of free numbers on one member; pure."""
        return self.objective(self.metrics(free, member))

    def guide(self, free: Any, member: Member) -> Any:
        """The same, with a derivative that forgets what was long ago; pure."""
        options = {
            "gradient_memory": self.gradient_memory,
            "checkpoint_every": self._checkpoint_every(),
        }
        return self.objective(self.metrics(free, member, **options))

    def metrics(self, free: Any, member: Member, **options: Any) -> Metrics:
        """The metrics of free numbers on one member, with options of `evaluate`."""
        run = with_member(self.space.write(self.loop, free), member)
        return evaluate(*run, **options)

    def _checkpoint_every(self) -> int:
        """1 as long as a gradient's states fit in memory; that is a sixth faster."""
        clock = self.loop.scenario.clock
        states = STATE_SIZE * clock.dt.dtype.itemsize * member_count(self.training)
        if clock.ticks * states <= STATES_LIMIT:
            return 1
        return sparse_checkpoints(clock.ticks)

    def losses_on(self, members: Member) -> Callable[[Any], Series]:
        """Compiled: the objective of each row of free numbers on some members."""
        how = self.aggregate, self.unit, jax.devices()
        return jax.jit(lambda rows: losses(self.loss, rows, members, *how))

    def on_members(self) -> Callable[[ClosedLoop, Member], Metrics]:
        """Compiled: the metrics of a closed loop on each of some members."""

        def run(loop: ClosedLoop, members: Member) -> Metrics:
            return map_members(
                lambda m: evaluate(*with_member(loop, m)),
                members,
                devices=jax.devices(),
            )

        return jax.jit(run)


def build_task(options: argparse.Namespace) -> TuningProblem:
    """A task from the options of the command line.

    Raises:
        ValueError: an option or a file cannot be used.
    """
    case = FlightCase.of_options(options)
    kind, loop = _start(options, case)
    uncertainty = _uncertainty(options, loop.scenario)
    loop = dataclasses.replace(loop, scenario=uncertainty.scenario)
    weights, aggregate = read_objective(options.objective)
    if options.aggregate:
        aggregate = dataclasses.replace(aggregate, kind=options.aggregate)
    cost = load_cost(options.cost) if options.cost else None
    paths = tuple(options.free) or DEFAULT_FREE[kind]
    constraints = () if options.unconstrained else ("k1-below-k2-squared",)
    space = Space.of(loop, paths, constraints)

    def draw(which: int, count: int) -> Member:
        if options.members == 1:
            return nominal_member(loop)
        return sample_members(uncertainty, options.seed, which, count)

    objective = Objective(_reference(loop, kind, case), weights, cost)
    return TuningProblem(
        case,
        kind,
        loop,
        space,
        objective,
        aggregate,
        draw(TRAINING, options.members),
        draw(VALIDATION, options.validation),
        draw(TEST, options.test),
        objective.unit(),
        options.gradient_memory or None,
    )


def _uncertainty(options: argparse.Namespace, scenario: Scenario) -> Uncertainty:
    """What differs between members: one half width for all, or what a file says."""
    if isinstance(options.uncertainty, Path):
        if options.amplitude is not None or options.position is not None:
            raise ValueError(
                "--amplitude and --position go with a number for --uncertainty; "
                f"{options.uncertainty} says itself how far waves and starts differ."
            )
        return load_uncertainty(options.uncertainty, scenario)
    half = options.uncertainty
    return uniform_uncertainty(
        scenario,
        half,
        half if options.amplitude is None else options.amplitude,
        options.position or 0.0,
    )


def _reference(loop: ClosedLoop, kind: str, case: FlightCase) -> Metrics:
    """The nominal run with the starting gains, or with the paper's if that fails."""
    run = jax.jit(evaluate)
    member = jax.tree.map(lambda x: x[0], nominal_member(loop))
    start: Metrics = run(*with_member(loop, member))
    if bool(start.finite):
        return start
    (gains,) = case.resolve([PAPER], [kind])
    paper_loop = dataclasses.replace(case.loop(gains)[1], scenario=loop.scenario)
    return run(*with_member(paper_loop, member))


def _start(options: argparse.Namespace, case: FlightCase) -> tuple[str, ClosedLoop]:
    """The kind of controller and the closed loop to start from.

    Raises:
        ValueError: the gains are of another kind than asked for.
    """
    asked = options.controller
    words = [PAPER] if case.own is None else [MISSION, PAPER]
    if options.gains is not None:
        words = [str(options.gains)]
    for word in words:
        (gains,) = case.resolve([word], [asked or DEFAULT_CONTROLLER[case.plant]])
        kind, loop = case.loop(gains)
        if asked in (None, kind):
            return kind, loop
    raise ValueError(f"--controller is {asked}, but {options.gains} holds {kind}.")
