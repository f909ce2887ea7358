"""What goes into one control tick, and the glider's own part of it."""

from typing import Any

import equinox as eqx
import jax

from jaxglider.control.funnel import Limits
from jaxglider.control.performance import Bound
from jaxglider.core.containers import Scalar
from jaxglider.signals import BodyAxes, Channels, Command, GliderState
from jaxglider.simulation.metrics import Sums


class Carry(eqx.Module):
    """What one tick hands to the next."""

    state: GliderState
    held: Command[Scalar]
    reference: Any
    controller: Any
    observer: Any
    sums: Sums
    finished: jax.Array
    reached: jax.Array


class TickPlan(eqx.Module):
    """What is known of a tick before the rollout starts; built for many at once.

    Attributes:
        time: start of the tick [s].
        force_end: τ_d at its end.
        planned: the reference's plan.
        bounds: the controller's performance functions, or None where the clock is not
            known beforehand.
        judging: those of the scenario's funnel, if it has one; None likewise.
        noise_end: errors of the sensors at its end, or None.
    """

    time: jax.Array
    force_end: BodyAxes[jax.Array]
    planned: Any
    bounds: Channels[Bound] | None
    judging: Channels[Bound] | None
    noise_end: dict[str, jax.Array] | None


class TickInput(TickPlan):
    """The same with what is known at the end of the tick before.

    Attributes:
        force_start: τ_d at the start of the tick.
        noise_start: errors of the sensors there, or None.
    """

    force_start: BodyAxes[jax.Array]
    noise_start: dict[str, jax.Array] | None


def with_start(
    plan: TickPlan,
    force: BodyAxes[jax.Array],
    noise: dict[str, jax.Array] | None,
) -> TickInput:
    """A plan with τ_d and the errors of the sensors at the start of its ticks."""
    return TickInput(**vars(plan), force_start=force, noise_start=noise)


class TickRecord(eqx.Module):
    """One tick as it was; a trajectory is this with a leading time axis.

    Attributes:
        time: start of the tick [s].
        active: the mission was still on.
        state: at the start of the tick.
        reference: η_d [m, rad].
        error: η − η_d [m, rad].
        limits: edges of the funnel [m, rad].
        surface: the controller's sliding variable.
        wanted: command asked for.
        applied: command held.
        estimate: d̂ at the start of the tick [N, N m].
        lumped: what d̂ should be [N, N m]: the mean over the tick of what the design
            model leaves unexplained (the disturbance itself without a design model).
        disturbance: τ_d at the start of the tick [N, N m].
        target: waypoint or segment being followed.
        clock: t*, time since the funnel's restart [s].
    """

    time: Scalar
    active: jax.Array
    state: GliderState
    reference: Channels[Scalar]
    error: Channels[Scalar]
    limits: Channels[Limits]
    surface: Channels[Scalar]
    wanted: Command[Scalar]
    applied: Command[Scalar]
    estimate: BodyAxes[Scalar]
    lumped: BodyAxes[Scalar]
    disturbance: BodyAxes[Scalar]
    target: jax.Array
    clock: Scalar
