"""The paper's measures of control performance, from running sums.

Per channel, over the active time T_f: max |e|, √(1/T_f ∫ e² dt), √(1/T_f ∫ u² dt),
chattering √(mean (U_j − U_{j−1})²) with j from the second command on, the way that the
actuator goes, and the share of time outside the funnel. Commands are the applied ones;
depth goes with the buoyancy mass, pitch with the position of the moving mass, heading
with its angle. max |e| is also given over t* > T alone, where the funnel has reached
its final bound.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control.prescribed.funnel import Limits
from jaxglider.control.prescribed.performance import Bound
from jaxglider.core.containers import Flag, Scalar
from jaxglider.core.numerics import square_root
from jaxglider.navigation.errors import NavigationMetrics
from jaxglider.signals import Channels, Command, GliderState, map_fields
from jaxglider.simulation.flight import FlightMetrics


class ChannelSums(eqx.Module):
    """Running sums of one channel; `outside` and `saturated` count ticks.

    `crowding` and `excess` are smooth stand-ins for these two, for gradients.
    `max_error_settled` is below zero until the funnel settles.
    """

    error_squared: Scalar
    effort_squared: Scalar
    change_squared: Scalar
    travel: Scalar
    max_error: Scalar
    max_error_settled: Scalar
    outside: Scalar
    saturated: Scalar
    peak: Scalar
    crowding: Scalar
    excess: Scalar


class Sums(eqx.Module):
    """Running sums of a rollout."""

    ticks: Scalar
    channels: Channels[ChannelSums]
    max_roll: Scalar
    max_pitch: Scalar


class ChannelMetrics(eqx.Module):
    """Measures of one channel.

    Attributes:
        max_error: max |e| [m or rad].
        max_error_settled: max |e| over t* > T alone; NaN if that was never reached.
        rms_error: L2[e] [m or rad].
        rms_effort: L2[U], applied [kg, m or rad].
        chattering: L2[ΔU], applied, per tick [kg, m or rad].
        travel: way of the actuator over the whole run, Σ |ΔU| applied [kg, m or rad].
        time_outside_funnel: share of the active time.
        time_saturated: share of the active time with the actuator short of the command.
        funnel_peak: largest error over the edge of the funnel that it nears: above 1
            it has left.
        funnel_crowding: mean of y⁴/(1 + y⁴), y = max(5x − 4, 0), x the error over the
            edge it nears: 0 up to 0.8, ½ at the edge, 1 far outside; a smooth stand-in
            for the time outside.
        saturation_excess: mean of d²/(u² + d²), u the applied command and d what is
            wanted beyond it: a smooth stand-in for the time saturated.
    """

    max_error: Scalar
    max_error_settled: Scalar
    rms_error: Scalar
    rms_effort: Scalar
    chattering: Scalar
    travel: Scalar
    time_outside_funnel: Scalar
    time_saturated: Scalar
    funnel_peak: Scalar
    funnel_crowding: Scalar
    saturation_excess: Scalar


class Metrics(eqx.Module):
    """Measures of a whole rollout; zeros where it was over before its first tick.

    Attributes:
        channels: measures of each channel.
        end_time: active time [s].
        max_roll: largest |φ| [rad].
        max_pitch: largest |θ| [rad].
        waypoints_reached: number of waypoints reached, or of schedule segments
            completed.
        finite: flag, nothing became NaN or infinite.
        capsized: flag, |φ| exceeded π/2.
        status: number of the end of the mission, an index of `phases.STATUSES`; None
            where the reference knows no such ends.
        flight: measures of the flight; None where it is not measured.
        navigation: errors of what is known on board; None without instruments.
    """

    channels: Channels[ChannelMetrics]
    end_time: Scalar
    max_roll: Scalar
    max_pitch: Scalar
    waypoints_reached: jax.Array
    finite: Flag
    capsized: Flag
    status: jax.Array | None = None
    flight: FlightMetrics | None = None
    navigation: NavigationMetrics | None = None


def empty_sums(like: Scalar) -> Sums:
    """Sums before the first tick, in the precision of `like`."""
    zero = jnp.zeros_like(like)
    empty = ChannelSums(*(zero,) * 11)
    empty = dataclasses.replace(empty, max_error_settled=zero - 1.0)
    return Sums(
        ticks=zero,
        channels=Channels(empty, empty, empty),
        max_roll=zero,
        max_pitch=zero,
    )


@jax.named_scope("metrics")
def add_tick(
    sums: Sums,
    *,
    state: GliderState,
    error: Channels[Scalar],
    bounds: Channels[Bound],
    limits: Channels[Limits],
    wanted: Command[Scalar],
    applied: Command[Scalar],
    held: Command[Scalar],
) -> Sums:
    """Sums with one more tick.

    Args:
        sums: sums over the ticks before.
        state: true state at the start of the tick.
        error: e [m, rad].
        bounds: performance functions.
        limits: edges of the funnel.
        wanted: command asked for.
        applied: command held in this tick.
        held: command held in the tick before.
    """
    first = sums.ticks == 0.0

    def add(
        s: ChannelSums,
        e: Scalar,
        b: Bound,
        lim: Limits,
        w: Scalar,
        u: Scalar,
        h: Scalar,
    ) -> ChannelSums:
        size = jnp.abs(e)
        outside = (e < lim.lower) | (e > lim.upper)
        # Reciprocals of the limits: often one for all lanes, an error never is.
        nearness = jnp.maximum(e * (1.0 / lim.upper), e * (1.0 / lim.lower))
        return ChannelSums(
            error_squared=s.error_squared + e * e,
            effort_squared=s.effort_squared + u * u,
            change_squared=s.change_squared + jnp.where(first, 0.0, u - h) ** 2,
            travel=s.travel + jnp.abs(u - h),
            max_error=jnp.maximum(s.max_error, size),
            max_error_settled=jnp.maximum(
                s.max_error_settled, jnp.where(b.settled, size, -1.0)
            ),
            outside=s.outside + jnp.where(outside, 1.0, 0.0),
            saturated=s.saturated + jnp.where(w != u, 1.0, 0.0),
            peak=jnp.maximum(s.peak, nearness),
            crowding=s.crowding + _crowded(nearness),
            excess=s.excess + (w - u) ** 2 / (u * u + (w - u) ** 2 + 1e-12),
        )

    channels = map_fields(
        add,
        sums.channels,
        error,
        bounds,
        limits,
        _by_channel(wanted),
        _by_channel(applied),
        _by_channel(held),
    )
    return Sums(
        ticks=sums.ticks + 1.0,
        channels=channels,
        max_roll=jnp.maximum(sums.max_roll, jnp.abs(state.roll)),
        max_pitch=jnp.maximum(sums.max_pitch, jnp.abs(state.pitch)),
    )


def _crowded(nearness: Scalar) -> Scalar:
    squared = jnp.clip(5.0 * nearness - 4.0, 0.0, 1e3) ** 2
    return squared * squared / (1.0 + squared * squared)


def finish(
    sums: Sums,
    state: GliderState,
    reached: jax.Array,
    dt: Scalar,
    status: jax.Array | None = None,
) -> Metrics:
    """Metrics from the sums of a whole rollout.

    Args:
        sums: sums over all active ticks.
        state: state at the end.
        reached: waypoints reached or segments completed.
        dt: tick [s].
        status: number of the end of the mission, or None.
    """
    # Where no tick was flown there is nothing to be wrong: all sums are zero.
    n = jnp.maximum(sums.ticks, 1.0)

    def close(s: ChannelSums) -> ChannelMetrics:
        return ChannelMetrics(
            max_error=s.max_error,
            max_error_settled=jnp.where(
                s.max_error_settled < 0.0, jnp.nan, s.max_error_settled
            ),
            rms_error=square_root(s.error_squared / n),
            rms_effort=square_root(s.effort_squared / n),
            chattering=square_root(s.change_squared / n),
            travel=s.travel,
            time_outside_funnel=s.outside / n,
            time_saturated=s.saturated / n,
            funnel_peak=s.peak,
            funnel_crowding=s.crowding / n,
            saturation_excess=s.excess / n,
        )

    leaves = jax.tree.leaves((sums, state))
    finite = jnp.asarray(True)
    for leaf in leaves:
        finite = finite & jnp.isfinite(leaf)
    return Metrics(
        channels=map_fields(close, sums.channels),
        end_time=sums.ticks * dt,
        max_roll=sums.max_roll,
        max_pitch=sums.max_pitch,
        waypoints_reached=reached,
        finite=finite,
        capsized=~(sums.max_roll <= 0.5 * jnp.pi),
        status=status,
    )


def _by_channel(command: Command[Scalar]) -> Channels[Scalar]:
    return Channels(command.buoyancy_mass, command.mass_position, command.mass_angle)
