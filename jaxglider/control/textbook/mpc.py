"""Linear model predictive control: the regulator of `lqr`, told what actuators can do.

Once in a period it plans N moves u of the command about the trim of the wanted glide,

min Σ_k (x_kᵀQ x_k + u_kᵀR u_k) + x_NᵀP x_N,   x_{k+1} = A x_k + B u_k,
|U* + u_k| ≤ U_max,   |u_k − u_{k−1}| ≤ T U'_max,   U* + u_{−1} what the actuators hold,

and carries out the first: U = U* + u_0. A and B are those of the design model about a
dive and about a climb, P the cost of what comes after the horizon by the Riccati
equation. Where no bound is met, that is the LQR of the same weights, whatever N. The
program is solved by a fixed number of rounds (`horizon`); the first move is then cut to
its bounds, so that no command is beyond them. Every round is differentiable, and so is
the design: weights are tuned through both.

Where a plan orders the ballast, it is a bound: u of the ballast is zero.

Source: I. Abraham and J. Yi, American Control Conference 2015, 1181-1186 (linear
predictive control of a glider); P. O. M. Scokaert and J. B. Rawlings, IEEE Trans.
Automatic Control 43 (1998) 1163-1169. Assumed: as in `regulator`; the trim stays as it
is over the horizon; bounds of states, such as the roll, are left to the weights. Bounds
of the command begin as those of a SeaWing: for other actuators set them.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.control.balance import wanted_trim
from jaxglider.control.controller import ControlRecord, tracking_error
from jaxglider.control.parts import is_due
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.textbook.horizon import Plan, planned, solved
from jaxglider.control.textbook.linear_design import fields_of
from jaxglider.control.textbook.regulator import AbstractRegulator
from jaxglider.core.containers import Container, Scalar, check_interval
from jaxglider.core.numerics import saturate
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    zeros,
)


def _limit() -> Command[Scalar]:
    return Command(0.4, 0.06, jnp.pi / 2)


def _rate_limit() -> Command[Scalar]:
    return Command(0.02, 0.005, 0.2)


class Plans(eqx.Module):
    """Matrices about a dive and about a climb.

    Attributes:
        dive: matrices in dives.
        climb: matrices in climbs.
    """

    dive: Plan
    climb: Plan


class PlanningState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        elapsed: time since the law last ran; before it did, longer than any period [s].
        plans: matrices, or None where the law has them.
        command: command of the last run [kg, m, rad].
    """

    elapsed: Scalar
    plans: Plans | None
    command: Command[Scalar]


class MPC(AbstractRegulator):
    """Least quadratic cost within bounds of the command and its rate.

    Attributes:
        limit: U_max, largest modulus of each command [kg, m, rad].
        rate_limit: U'_max, largest modulus of its rate [kg/s, m/s, rad/s].
        horizon: N, number of moves that are planned.
        rounds: number of rounds of each run.
        plans: matrices, or None to work them out from the weights before the first
            tick.

    Raises:
        ValueError: a number is outside its set.
    """

    limit: Command[Scalar] = eqx.field(
        default_factory=_limit, metadata={"set": POSITIVE, "tuned": False}
    )
    rate_limit: Command[Scalar] = eqx.field(
        default_factory=_rate_limit, metadata={"set": POSITIVE, "tuned": False}
    )
    horizon: int = eqx.field(static=True, default=8)
    rounds: int = eqx.field(static=True, default=10)
    plans: Plans | None = eqx.field(default=None, metadata={"tuned": False})

    def __check_init__(self) -> None:
        for name in ("horizon", "rounds"):
            check_interval("MPC", name, getattr(self, name), 1.0, closed_low=True)

    def design(self) -> Plans:
        """The matrices about the dive and about the climb."""
        return Plans(*self.of_both(lambda step: planned(step, self.horizon)))

    def on_board(self) -> "MPC":
        """The law with its matrices as they are: nothing is inverted on board."""
        return dataclasses.replace(self, plans=self.design())

    def init(self) -> PlanningState:
        """The matrices, and nothing planned."""
        zero = jnp.zeros_like(self.period)
        return PlanningState(
            elapsed=self.period,
            plans=self.design() if self.plans is None else None,
            command=zeros(Command, zero),
        )

    def step(
        self,
        state: PlanningState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], PlanningState, ControlRecord]:
        """One tick: a run of the law, or what its last run told."""
        error, rate = tracking_error(measurement, reference)
        plans = state.plans if self.plans is None else self.plans
        assert plans is not None  # `init` works them out where none are given.
        due = is_due(state.elapsed, self.period, dt)
        # A branch, not a choice: most ticks do without the rounds.
        command = lax.cond(
            due,
            lambda: self._run(plans, measurement, reference, error, dt),
            lambda: state.command,
        )
        elapsed = jnp.where(due, 0.0, state.elapsed) + dt
        following = PlanningState(elapsed, state.plans, command)
        return command, following, ControlRecord(error, rate)

    def _run(
        self,
        plans: Plans,
        measurement: Measurement,
        reference: Reference,
        error: Channels[Scalar],
        dt: Scalar,
    ) -> Command[Scalar]:
        """The command of a run."""
        counted = map_fields(saturate, error, self.largest)
        deviation = _column(self.deviation(measurement, reference, counted))
        trim = _column(wanted_trim(self.model, measurement, reference))
        limit, unit = _column(self.limit), jnp.sqrt(_column(self.efforts))
        held = jnp.clip(_column(measurement.applied), -limit, limit) - trim
        low, high = -limit - trim, limit - trim
        if measurement.buoyancy_mass is not None:
            moved = jnp.asarray([0.0, 1.0, 1.0], unit.dtype)
            low, high, held = moved * low, moved * high, moved * held
        reach = _column(self.rate_limit) * jnp.maximum(self.period, dt)
        every = jnp.ones((self.horizon, 1), unit.dtype)
        first = jnp.concatenate(
            [held[None], jnp.zeros((self.horizon - 1, 3), unit.dtype)]
        )
        below = jnp.stack([every * low, first - reach]) * unit
        above = jnp.stack([every * high, first + reach]) * unit
        climbing = reference.position.pitch > 0.0
        plan = Plan(
            jnp.where(climbing, plans.climb.free, plans.dive.free),
            jnp.where(climbing, plans.climb.rounds, plans.dive.rounds),
        )
        moves = solved(plan, deviation, below, above, self.rounds)
        least, most = jnp.maximum(low, held - reach), jnp.minimum(high, held + reach)
        told = trim + jnp.clip(moves[0] / unit, least, most)
        return Command(*told)


def _column(numbers: Container) -> Float[Array, " n"]:
    """The numbers of a container as a vector."""
    return jnp.stack(fields_of(numbers))
