"""The peer in diffrax: a solve for each tick, inside a scan over the ticks.

The command is held over a tick and depends on the state at its start. One solve over
the whole horizon would have to step the controller from inside the vector field, so a
solve for each tick is the natural use. There is no classical RK4 among the solvers; a
tableau makes one. Everything but the integration is jaxglider's own code, and so is the
batching: what is compared is the integrator.
"""

from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider import ClosedLoop, Metrics
from jaxglider.signals import BodyAxes, GliderState, Measurement, map_fields
from jaxglider.simulation.metrics import add_tick, finish
from jaxglider.simulation.rollout import Carry, TickInput
from jaxglider.vehicle.actuators import follow_all


class RK4(diffrax.AbstractERK):
    """The classical method of fourth order."""

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0]),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        b_error=np.zeros(4),
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
    )
    interpolation_cls: ClassVar[Any] = (
        diffrax.ThirdOrderHermitePolynomialInterpolation.from_k
    )

    def order(self, terms: Any) -> int:
        """4."""
        return 4


def evaluate(loop: ClosedLoop, sea: BodyAxes[Any]) -> Metrics:
    """Metrics of one closed loop; `jax.vmap` for many."""
    scenario, controller, observer = loop.scenario, loop.controller, loop.observer
    dt = scenario.clock.dt

    def derivative(time: Any, state: GliderState, held: Any) -> GliderState:
        command, inputs = held
        slope = inputs.plan.force_end - inputs.force_start
        force = map_fields(lambda f, k: f + time / dt * k, inputs.force_start, slope)
        return scenario.plant.derivative(state, command, force)

    def tick(carry: Carry, inputs: TickInput) -> tuple[Carry, None]:
        state = carry.state
        measurement = Measurement(
            state=state,
            attitude=state.attitude(),
            applied=carry.held,
            disturbance=observer.estimate(carry.observer),
        )
        reference, _ = scenario.reference.step(
            None, inputs.plan.planned, measurement, dt
        )
        wanted, integral, record = controller.step(
            carry.controller, measurement, reference, inputs.plan.bounds, dt
        )
        applied = follow_all(scenario.actuators, carry.held, wanted, dt)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(derivative),
            RK4(),
            t0=jnp.zeros_like(dt),
            t1=dt,
            dt0=dt,
            y0=state,
            args=(applied, inputs),
        )
        following = jax.tree.map(lambda x: x[0], solution.ys)
        seen = observer.step(carry.observer, measurement, applied, following, dt)
        limits = controller.limits(inputs.plan.bounds)
        sums = add_tick(
            carry.sums,
            state=state,
            error=record.error,
            bounds=inputs.plan.bounds,
            limits=limits,
            wanted=wanted,
            applied=applied,
            held=carry.held,
        )
        after = Carry(
            state=following,
            held=applied,
            reference=carry.reference,
            controller=integral,
            observer=seen,
            sums=sums,
            finished=carry.finished,
            reached=carry.reached,
        )
        return after, None

    last, _ = lax.scan(tick, loop.init(), loop.inputs(sea))
    return finish(last.sums, last.state, last.reached, dt)
