"""The gradient at tuned gains, on the nominal case as it is flown."""

from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.core.kept.programs import kept
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.gradient_check.statement import GradientStatement, gradient_statement
from tuning.problem.members import nominal_member
from tuning.problem.problem import TuningProblem


class GradientProbe:
    """Says what the exact gradient of the nominal run is worth, compiled once."""

    def __init__(self, problem: TuningProblem) -> None:
        """Prepare.

        Args:
            problem: problem whose objective is differentiated.
        """
        member = jax.tree.map(lambda x: x[0], nominal_member(problem.loop))

        def loss(free: Series) -> Any:
            return problem.exact_loss(free, member)

        self._problem = problem
        self._slope = kept(jax.value_and_grad(loss))
        self._losses = kept(lambda rows: map_members(loss, rows))

    def __call__(self, loop: ClosedLoop) -> GradientStatement:
        """The statement on the gradient at the gains of a closed loop."""
        clock = self._problem.loop.scenario.clock
        free = self._problem.space.read(loop)
        return gradient_statement(
            lambda x: jax.device_get(self._slope(jnp.asarray(x))),
            lambda rows: jax.device_get(self._losses(jnp.asarray(rows))),
            jax.device_get(free),
            float(clock.ticks * clock.dt),
        )
