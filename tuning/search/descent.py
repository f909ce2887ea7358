"""Gradient descent through the rollout, over an ensemble.

The exact gradient of a long run is a poor guide: where the loop oscillates it grows by
orders of magnitude with the horizon and changes within a few percent of the gains
(`jaxglider check-gradients` shows it). Three things make it useful: the gradient
forgets what was long ago (`rollout.evaluate`); each lane of the ensemble has its own
copy of the gains, scattered by a few percent; and a gradient g longer than c, some
multiple of what a run like the start costs, counts for (c/|g|)² g. So a glider near its
limits, whose objective is steep, is heard among those that fly with ease, and one whose
loop is chaotic is not. A gradient takes some of the members in turn, which costs less
and leads as far; the step is judged by all of them, at the gains themselves.

A step that makes the objective much worse, or not finite, is refused: back to the gains
with the best objective so far, with half the step, which then grows again by a tenth
with every step that is taken. What is returned is another matter:
the gains that are best on members the descent does not see. The steps shrink along half
a cosine. Several descents from scattered starts can run side by side.
"""

import copy
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from jaxglider.core.containers import Series
from jaxglider.core.kept.programs import kept
from tuning.problem.aggregates import MEAN, AbstractAggregate
from tuning.problem.ensemble_gradient import EnsembleGradient
from tuning.problem.lanes import FAILED_COST, Loss, member_count
from tuning.problem.objective import DEFAULT_COST_SCALE
from tuning.search.settings import (
    DescentSettings,
    Evaluation,
    Point,
    Proposal,
    State,
    Step,
    make_optimiser,
)


class Descent:
    """Descents on one ensemble: compiled once, stepped as often as wanted."""

    def __init__(
        self,
        loss: Loss,
        training: Any,
        validation: Any,
        settings: DescentSettings,
        aggregate: AbstractAggregate = MEAN,
        *,
        surrogate_loss: Loss | None = None,
        cost_scale: float = DEFAULT_COST_SCALE,
        devices: Sequence[jax.Device] | None = None,
    ) -> None:
        """Prepare.

        Args:
            loss: objective of free numbers and one member; pure.
            training: members to descend on, one leading axis.
            validation: members to choose by.
            settings: settings of the descent.
            aggregate: mean, CVaR or soft worst of the members' objectives; the mean by
                default.
            surrogate_loss: loss that is differentiated instead of `loss`; of the same
                values.
            cost_scale: cost of a run like the start, the scale of poor and failed ones.
            devices: devices to spread the members over.
        """
        self.settings = settings
        self._cost_scale = cost_scale
        self._members = training, validation
        self._optimiser = make_optimiser(settings.optimiser)
        # The costly part is one program, for the start and for every step.
        self._ensemble = EnsembleGradient(
            loss=loss,
            surrogate=surrogate_loss or loss,
            aggregate=aggregate,
            cost_scale=cost_scale,
            batch=settings.batch_of(member_count(training), aggregate),
            copies=settings.copies,
            spread=settings.spread,
            steepest=settings.steepest,
            seed=settings.seed,
            devices=devices,
        )
        self._evaluate_jit = kept(self._ensemble)
        self._propose_jit = jax.jit(self._propose)
        self._accept_jit = jax.jit(self._accept)

    def on(self, training: Any, validation: Any) -> "Descent":
        """The same descent on as many other members, with the same programs.

        Args:
            training: members to descend on.
            validation: members to choose by.
        """
        other = copy.copy(self)
        other._members = training, validation
        return other

    def start(self, free: Series) -> State:
        """The state before the first step; further starts are scattered around it."""
        settings = self.settings
        offsets = settings.start_spread * jr.normal(
            jr.fold_in(jr.key(settings.seed), 2**31),
            (settings.starts, free.shape[0]),
            free.dtype,
        )
        return self._first_state(free + offsets.at[0].set(0.0))

    def advance(self, state: State) -> tuple[State, Step]:
        """One step of every descent."""
        proposal = self._propose_jit(state)
        outcome = self._evaluate_at(proposal.free, state.number + 1)
        state, refused = self._accept_jit(state, proposal, outcome)
        j = state.leader()
        validation = np.asarray(outcome.validation)
        step = Step(
            number=int(state.number),
            loss=float(outcome.loss[j]),
            validation=float(validation[j]),
            free=proposal.free[j],
            refused=bool(refused[j]),
            best=bool(validation[j] == np.asarray(state.chosen_loss)[j]),
            learning_rate=float(proposal.rate[j]),
        )
        return state, step

    def run(self, state: State) -> Iterator[tuple[State, Step]]:
        """Step until the steps are used up or every descent is on a plateau, or blind.

        Raises:
            FloatingPointError: the objective is not finite at any of the starts.
        """
        if not self.can_run(state):
            raise FloatingPointError(
                "the objective is not finite at the starting gains, for no member; "
                "start from gains that complete the run (--gains), or scatter several "
                "starts around these (--starts)."
            )
        settings = self.settings
        while (
            int(state.number) < settings.steps
            and int(np.min(np.asarray(state.since))) < settings.patience
            and not self.is_blind(state)
        ):
            state, step = self.advance(state)
            yield state, step

    def can_run(self, state: State) -> bool:
        """Whether the objective of any descent is below that of lost runs alone."""
        lost = FAILED_COST * self._cost_scale
        return bool(np.any(np.asarray(state.best.loss) < lost))

    def is_blind(self, state: State) -> bool:
        """Whether no descent had a finite gradient while every member had its turn."""
        return int(np.min(np.asarray(state.blind))) >= self.deals

    @property
    def deals(self) -> int:
        """Steps in which every member has its turn in the gradient."""
        return self._ensemble.deals(self._members[0])

    def _first_state(self, free: jax.Array) -> State:
        number = jnp.asarray(0, jnp.int32)
        outcome = self._evaluate_at(free, number)
        point = Point(free=free, slope=outcome.slope, loss=outcome.loss)
        return State(
            number=number,
            current=point,
            best=point,
            chosen_free=free,
            chosen_loss=outcome.validation,
            optimiser=jax.vmap(self._optimiser.init)(free),
            shrink=jnp.ones_like(outcome.loss),
            since=jnp.zeros(free.shape[0], jnp.int32),
            blind=jnp.where(outcome.usable, 0, 1).astype(jnp.int32),
        )

    def _evaluate_at(self, free: jax.Array, number: jax.Array) -> Evaluation:
        """By way of the host: what lies on several devices would compile anew."""
        rows, step = jax.device_get((free, number))
        return Evaluation(*self._evaluate_jit(rows, step, self._members))

    def _propose(self, state: State) -> Proposal:
        """The next step: the optimiser's update at the rate in force."""
        settings = self.settings
        turn = jnp.pi * state.number / settings.steps
        rate = settings.learning_rate * state.shrink * 0.5 * (1.0 + jnp.cos(turn))
        update, optimiser = jax.vmap(self._optimiser.update)(
            state.current.slope, state.optimiser, state.current.free
        )
        free = state.current.free + rate[:, None] * update
        return Proposal(free=free, optimiser=optimiser, rate=rate)

    def _accept(
        self, state: State, proposal: Proposal, outcome: Evaluation
    ) -> tuple[State, jax.Array]:
        """The state after a step, and which steps were refused."""
        settings = self.settings
        loss, validation = outcome.loss, outcome.validation
        refused = ~(loss <= settings.worse * state.best.loss)
        better = ~refused & (loss < state.best.loss)
        chosen = ~refused & (validation < state.chosen_loss)
        target = state.chosen_loss * (1.0 - settings.progress)
        progress = ~refused & (validation < target)
        tried = Point(free=proposal.free, slope=outcome.slope, loss=loss)
        fresh = jax.vmap(self._optimiser.init)(state.best.free)
        following = State(
            number=state.number + 1,
            current=_select(refused, state.best, tried),
            best=_select(better, tried, state.best),
            chosen_free=_select(chosen, tried.free, state.chosen_free),
            chosen_loss=_select(chosen, validation, state.chosen_loss),
            optimiser=_select(refused, fresh, proposal.optimiser),
            shrink=jnp.minimum(jnp.where(refused, 0.5, 1.1) * state.shrink, 1.0),
            since=jnp.where(progress, 0, state.since + 1),
            blind=jnp.where(outcome.usable | refused, 0, state.blind + 1),
        )
        return following, refused


def _select(flags: jax.Array, yes: Any, no: Any) -> Any:
    """Row by row one tree or another."""

    def pick(a: jax.Array, b: jax.Array) -> jax.Array:
        return jnp.where(flags.reshape(-1, *(1,) * (a.ndim - 1)), a, b)

    return jax.tree.map(pick, yes, no)
