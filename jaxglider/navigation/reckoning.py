"""Dead reckoning, fixes, and the current that the miss tells of.

Under water the position goes on by U along the heading, see `glide`, and by the current
as last known. At the surface, with the reckoned position x_r of the surfacing and the
fix x_s of the same moment,

v ← v + (x_s − x_r)/T,

T the time since the last fix before the dive: the mean current over all depths, used
on the next leg. The first fix comes late; it is taken back to the surfacing by the
drift between it and the newest one. A current that no sea has is not believed.

A glider is down, and up again, where its depth sensor and its estimator both say so: a
sensor may jump, and an estimator may go astray where the hull comes out of the water.

Source: what the on-board programs of gliders do; the velocity limit is Slocum's.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Container, Flag, Scalar, as_float
from jaxglider.core.numerics import sincos
from jaxglider.core.sets import NOT_NEGATIVE
from jaxglider.navigation.glide import angle_of_attack, horizontal_speed
from jaxglider.navigation.sensing.positioning import Fix
from jaxglider.signals import GliderState, depth_rate
from jaxglider.vehicle.parameters import GliderParameters

SURFACED, DIVED = 1.0, 3.0
"""Depths above and below which the reckoning takes a glider to be up, and down [m]."""
FASTEST = 2.8
"""Largest current that is believed [m/s]."""
_SHORTEST = 60.0
"""Time under water below which a miss tells nothing [s]."""
Pair = tuple[Scalar, Scalar]


class ReckoningState(eqx.Module):
    """Belief of the glider about its place.

    Attributes:
        place: reckoned position, north and east [m].
        current: current that is reckoned with [m/s].
        used: current that the last leg was reckoned with [m/s].
        speed: U, horizontal speed through the water [m/s].
        since: time since the last fix [s].
        leg: time since the last fix at the last surfacing [s].
        down: flag, the glider has dived since it was last up.
        up: time since the surfacing [s].
        surfaced: reckoned position of the last surfacing [m].
        first: first fix of this stay [m].
        first_at: time of it since the surfacing [s].
        fixes: number of fixes in this stay.
    """

    place: Pair
    current: Pair
    used: Pair
    speed: Scalar
    since: Scalar
    leg: Scalar
    down: Flag
    up: Scalar
    surfaced: Pair
    first: Pair
    first_at: Scalar
    fixes: Scalar


class Reckoning(Container):
    """Dead reckoning with a polar of the glider.

    Attributes:
        parameters: parameters that its pilots believe in.
        induced_drag: K_D [kg/m/rad²].

    Raises:
        ValueError: the drag is negative.
    """

    parameters: GliderParameters
    induced_drag: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )

    def init(self, state: GliderState) -> ReckoningState:
        """At the start, whose position is known, at the surface.

        Args:
            state: true state at the start.
        """
        zero = jnp.zeros_like(state.north)
        place, none = (state.north, state.east), (zero, zero)
        return ReckoningState(
            place=place,
            current=none,
            used=none,
            speed=zero,
            since=zero,
            leg=zero,
            down=jnp.asarray(False),
            up=zero,
            surfaced=place,
            first=place,
            first_at=zero,
            fixes=zero,
        )

    def step(
        self,
        before: ReckoningState,
        estimate: GliderState,
        shown: Scalar,
        fix: Fix | None,
        dt: Scalar,
    ) -> ReckoningState:
        """The belief one tick later.

        Args:
            before: belief one tick ago.
            estimate: estimated state at the end of the tick.
            shown: depth that its sensor shows [m].
            fix: position by satellite, or None without a receiver.
            dt: tick [s].
        """
        alpha = angle_of_attack(self.parameters, self.induced_drag, estimate.pitch)
        sinking = depth_rate(estimate)
        speed = horizontal_speed(estimate.pitch, alpha, sinking, before.speed, dt)
        sine, cosine = sincos(estimate.heading)
        north, east = before.place
        place = (
            north + dt * (speed * cosine + before.current[0]),
            east + dt * (speed * sine + before.current[1]),
        )
        surfacing = before.down & (jnp.maximum(estimate.depth, shown) < SURFACED)
        diving = jnp.minimum(estimate.depth, shown) > DIVED
        down = jnp.where(surfacing, False, before.down | diving)
        zero = jnp.zeros_like(speed)
        now = ReckoningState(
            place=place,
            current=before.current,
            used=_chosen(surfacing, before.current, before.used),
            speed=speed,
            since=before.since + dt,
            leg=jnp.where(surfacing, before.since + dt, before.leg),
            down=down,
            up=jnp.where(surfacing, zero, before.up + dt),
            surfaced=_chosen(surfacing, place, before.surfaced),
            first=before.first,
            first_at=before.first_at,
            fixes=jnp.where(surfacing, zero, before.fixes),
        )
        return now if fix is None else _fixed(now, fix)


def _fixed(now: ReckoningState, fix: Fix) -> ReckoningState:
    """The belief with a fix, if there is one."""
    here = fix.north, fix.east
    first = now.fixes == 0.0
    start, start_at = (
        _chosen(first, here, now.first),
        jnp.where(first, now.up, now.first_at),
    )
    between = now.up - start_at
    known = between > 0.0
    drift = jax.tree.map(
        lambda new, old, used: jnp.where(
            known, (new - old) / jnp.where(known, between, 1.0), used
        ),
        here,
        start,
        now.used,
    )
    back = jax.tree.map(lambda x, v: x - v * start_at, start, drift)
    long_enough = now.leg >= _SHORTEST
    leg = jnp.where(long_enough, now.leg, 1.0)
    told = jax.tree.map(lambda b, s, v: v + (b - s) / leg, back, now.surfaced, now.used)
    size = jnp.maximum(jnp.abs(told[0]), jnp.abs(told[1]))
    fresh = fix.fresh & ~now.down
    believed = fresh & long_enough & (size <= FASTEST)
    return ReckoningState(
        place=_chosen(fix.fresh, here, now.place),
        current=_chosen(believed, told, now.current),
        used=now.used,
        speed=now.speed,
        since=jnp.where(fix.fresh, 0.0, now.since),
        leg=now.leg,
        down=now.down,
        up=now.up,
        surfaced=now.surfaced,
        first=_chosen(fresh, start, now.first),
        first_at=jnp.where(fresh, start_at, now.first_at),
        fixes=now.fixes + jnp.where(fresh, 1.0, 0.0),
    )


def _chosen(flag: Flag, yes: Pair, no: Pair) -> Pair:
    chosen: Pair = jax.tree.map(lambda a, b: jnp.where(flag, a, b), yes, no)
    return chosen
