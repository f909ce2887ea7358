"""What a rollout leaves behind when every tick is kept."""

import equinox as eqx
import jax

from jaxglider._types import Scalar
from jaxglider.controllers.base import Limits
from jaxglider.metrics import Metrics
from jaxglider.signals import BodyAxes, Channels, Command, GliderState


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


class Trajectory(eqx.Module):
    """A rollout tick by tick.

    Attributes:
        ticks: records with a leading time axis.
        metrics: its measures.
    """

    ticks: TickRecord
    metrics: Metrics
