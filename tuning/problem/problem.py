"""A tuning problem put together: free numbers, members drawn, objective scaled."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.core.kept.programs import kept
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import evaluate, sparse_checkpoints
from jaxglider.uncertainty.members import Member, with_member
from tuning.problem.baseline import baseline_metrics, nominal_metrics
from tuning.problem.lanes import losses, member_count
from tuning.problem.members import (
    TEST,
    TRAINING,
    VALIDATION,
    nominal_member,
    sample_members,
)
from tuning.problem.objective import Objective
from tuning.problem.spec import ProblemSpec
from tuning.reporting.witness import Witness, assess
from tuning.space.space import Space

STATES_LIMIT = 2**30
"""Bytes of states that a gradient may keep."""


@dataclasses.dataclass(frozen=True)
class TuningProblem:
    """Everything that a search needs; made of a `ProblemSpec` by `of`.

    Attributes:
        spec: description that it was made of.
        loop: closed loop with the gains to start from, in the scenario of the ensemble.
        space: numbers that are free, and their sets.
        objective: cost of one rollout.
        training: members to descend on.
        validation: members to choose by.
        test: members for the verdict alone.
        cost_scale: cost of a run like the start; see `Objective.cost_scale`.
        starts_lost: whether the nominal run fails or rolls over at the start.
        start_fails: whether it becomes non-finite there.
    """

    spec: ProblemSpec
    loop: ClosedLoop
    space: Space
    objective: Objective
    training: Member
    validation: Member
    test: Member
    cost_scale: float
    starts_lost: bool = False
    start_fails: bool = False

    @classmethod
    def of(cls, spec: ProblemSpec) -> "TuningProblem":
        """Put a problem together; one rollout is compiled and run.

        Raises:
            ValueError: a path, a half width or a cost cannot be used.
        """
        ensemble = spec.ensemble
        uncertainty = ensemble.on(spec.loop)
        loop = dataclasses.replace(spec.loop, scenario=uncertainty.scenario)
        space = Space.of(
            loop, spec.paths, spec.constraints, spec.disturbance_rate_bound
        )

        def draw(kind: int, count: int) -> Member:
            if ensemble.training == 1:
                return nominal_member(loop)
            return sample_members(uncertainty, ensemble.seed, kind, count)

        start = nominal_metrics(loop)
        objective = Objective(
            baseline_metrics(spec, loop, start),
            spec.weights.limited(loop.scenario.specification),
            spec.cost,
        )
        return cls(
            spec=spec,
            loop=loop,
            space=space,
            objective=objective,
            training=draw(TRAINING, ensemble.training),
            validation=draw(VALIDATION, ensemble.validation),
            test=draw(TEST, ensemble.test),
            cost_scale=objective.cost_scale(),
            starts_lost=not bool(start.finite) or bool(start.capsized),
            start_fails=not bool(start.finite),
        )

    def loss(self, free: Any, member: Member) -> Any:
        """The objective of free numbers on one member; pure."""
        return self.objective(self.metrics(free, member))

    def exact_loss(self, free: Any, member: Member) -> Any:
        """The same, in little memory however long the run is; pure."""
        every = self._checkpoint_every(1)
        return self.objective(self.metrics(free, member, checkpoint_every=every))

    def surrogate_loss(self, free: Any, member: Member) -> Any:
        """The same, with a derivative that forgets what was long ago; pure."""
        options = {
            "gradient_memory": self.spec.gradient_memory,
            "checkpoint_every": self._checkpoint_every(member_count(self.training)),
        }
        return self.objective(self.metrics(free, member, **options))

    def metrics(self, free: Any, member: Member, **options: Any) -> Metrics:
        """The metrics of free numbers on one member, with options of `evaluate`."""
        run = with_member(self.space.write(self.loop, free), member)
        return evaluate(*run, **options)

    def _checkpoint_every(self, members: int) -> int:
        """1 as long as a gradient's states fit in memory; that is a sixth faster."""
        ticks = self.loop.scenario.clock.ticks
        state = jax.tree.leaves(jax.eval_shape(self.loop.init))
        size = sum(x.size * x.dtype.itemsize for x in state)
        if ticks * members * size <= STATES_LIMIT:
            return 1
        return sparse_checkpoints(ticks)

    def losses_on(self, members: Member) -> Callable[[Any], Series]:
        """Compiled: the objective of each row of free numbers on some members."""
        how = self.spec.aggregate, self.cost_scale, jax.devices()
        return kept(lambda rows: losses(self.loss, rows, members, *how))


@kept
def assess_members(loop: ClosedLoop, members: Member) -> tuple[Metrics, Witness]:
    """Metrics and witness of a closed loop on each of some members.

    Compiled, and traced once for all problems whose loops and members are of one kind.

    Args:
        loop: closed loop.
        members: gliders and seas, one leading axis.
    """
    return map_members(
        lambda m: assess(*with_member(loop, m)), members, devices=jax.devices()
    )
