"""Errors of the estimates: sums over a run, judged by the truth.

Errors are told apart by the time since the last inflection, or since the last segment
of a schedule began: the first `AFTER` seconds, and what follows. At the surface nobody
judges them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import square_root
from jaxglider.core.rotations import wrap
from jaxglider.navigation.reckoning import ReckoningState
from jaxglider.signals import GliderState, depth_rate, zeros

AFTER = 40.0
"""Time after an inflection in which estimates are still disturbed by it [s]."""


class Errors(eqx.Module):
    """Errors of an estimate; as sums, their squares, as a metric, root mean squares.

    Attributes:
        depth: error of the depth [m].
        depth_rate: error of the depth rate [m/s].
        pitch: error of the pitch [rad].
        heading: error of the heading [rad].
        surge: error of the surge through the water [m/s].
        sway: error of the sway through the water [m/s].
        heave: error of the heave through the water [m/s].
        roll_rate: error of p [rad/s].
        pitch_rate: error of q [rad/s].
        yaw_rate: error of r [rad/s].
    """

    depth: Scalar
    depth_rate: Scalar
    pitch: Scalar
    heading: Scalar
    surge: Scalar
    sway: Scalar
    heave: Scalar
    roll_rate: Scalar
    pitch_rate: Scalar
    yaw_rate: Scalar


class NavigationSums(eqx.Module):
    """Running sums.

    Attributes:
        ticks: number of ticks in the first `AFTER` seconds, and of others.
        after: squares of the errors in the first `AFTER` seconds.
        steady: squares of the errors otherwise.
        drifted: way of the water since the last fix, north and east [m].
        way: horizontal way over ground since then [m].
        drift: mean current of the last leg, north and east [m/s].
        surfacings: number of surfacings after a leg.
        miss: sum of the misses at surfacings [m].
        ways: sum of the ways of the legs [m].
        current: error of the current of the legs so far, summed [m/s].
        legs: number of legs whose current was told.
        newest: error of the current of the last leg [m/s]; summed at the next dive.
        told: number, 1 if a current was told in this stay.
    """

    ticks: tuple[Scalar, Scalar]
    after: Errors
    steady: Errors
    drifted: tuple[Scalar, Scalar]
    way: Scalar
    drift: tuple[Scalar, Scalar]
    surfacings: Scalar
    miss: Scalar
    ways: Scalar
    current: Scalar
    legs: Scalar
    newest: Scalar
    told: Scalar


class NavigationMetrics(eqx.Module):
    """Errors of the estimates; NaN where there was nothing to judge.

    Attributes:
        after: root mean square errors in the first 40 s after inflections.
        steady: root mean square errors otherwise.
        surfacings: number of surfacings after a leg under water.
        miss: mean distance between reckoned and true position at surfacings [m].
        miss_share: misses over the way made over ground.
        current_error: mean modulus of the error of the current of a leg [m/s].
    """

    after: Errors
    steady: Errors
    surfacings: Scalar
    miss: Scalar
    miss_share: Scalar
    current_error: Scalar


def empty_navigation(like: Scalar) -> NavigationSums:
    """Sums before the first tick, in the precision of `like`."""
    zero = jnp.zeros_like(like)
    none, pair = zeros(Errors, like), (zero, zero)
    return NavigationSums(
        ticks=pair,
        after=none,
        steady=none,
        drifted=pair,
        way=zero,
        drift=pair,
        **dict.fromkeys(
            ("surfacings", "miss", "ways", "current", "legs", "newest", "told"), zero
        ),
    )


@jax.named_scope("navigation_errors")
def add_errors(
    sums: NavigationSums,
    *,
    relative: GliderState,
    velocity: tuple[Scalar, Scalar],
    current: tuple[Scalar, Scalar],
    estimate: GliderState,
    since_inflection: Scalar,
    under_way: Scalar,
    reckoning: tuple[ReckoningState, ReckoningState],
    dt: Scalar,
) -> NavigationSums:
    """Sums with one more tick.

    Args:
        sums: sums over the ticks before.
        relative: true state at the end of the tick, velocity through the water.
        velocity: true velocity over ground there, north and east [m/s].
        current: true velocity of the water there [m/s].
        estimate: estimated state there.
        since_inflection: time since the last inflection or segment [s].
        under_way: number, 1 under water and 0 at the surface.
        reckoning: belief of place at the start and at the end of the tick.
        dt: tick [s].
    """
    errors = _squares(relative, estimate)
    early = since_inflection < AFTER
    one = jnp.where(early, under_way, 0.0)
    other = jnp.where(early, 0.0, under_way)
    before, now = reckoning
    surfacing = before.down & ~now.down
    diving = now.down & ~before.down
    # The last fix before the dive begins a leg: so does the true way.
    fixed = now.since == 0.0
    drifted = jax.tree.map(
        lambda d, v: jnp.where(fixed, 0.0, d + dt * v), sums.drifted, current
    )
    speed = square_root(velocity[0] ** 2 + velocity[1] ** 2)
    way = jnp.where(fixed, 0.0, sums.way + dt * speed)
    off = square_root(
        (now.place[0] - relative.north) ** 2 + (now.place[1] - relative.east) ** 2
    )
    leg = jnp.maximum(now.leg, dt)
    drift = jax.tree.map(
        lambda d, old: jnp.where(surfacing, d / leg, old), drifted, sums.drift
    )
    wrong = square_root(
        (now.current[0] - drift[0]) ** 2 + (now.current[1] - drift[1]) ** 2
    )
    telling = fixed & ~now.down & (sums.surfacings > 0.0)
    newest = jnp.where(telling, wrong, sums.newest)
    told = jnp.where(telling, 1.0, sums.told)
    return NavigationSums(
        ticks=(sums.ticks[0] + one, sums.ticks[1] + other),
        after=jax.tree.map(lambda s, e: s + one * e, sums.after, errors),
        steady=jax.tree.map(lambda s, e: s + other * e, sums.steady, errors),
        drifted=drifted,
        way=way,
        drift=drift,
        surfacings=sums.surfacings + jnp.where(surfacing, 1.0, 0.0),
        miss=sums.miss + jnp.where(surfacing, off, 0.0),
        ways=sums.ways + jnp.where(surfacing, way, 0.0),
        current=sums.current + jnp.where(diving, told * newest, 0.0),
        legs=sums.legs + jnp.where(diving, told, 0.0),
        newest=newest,
        told=jnp.where(diving, 0.0, told),
    )


def _squares(truth: GliderState, estimate: GliderState) -> Errors:
    names = ("depth", "surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
    errors = {name: getattr(estimate, name) - getattr(truth, name) for name in names}
    errors["pitch"] = wrap(estimate.pitch - truth.pitch)
    errors["heading"] = wrap(estimate.heading - truth.heading)
    errors["depth_rate"] = depth_rate(estimate) - depth_rate(truth)
    return Errors(**{name: error**2 for name, error in errors.items()})


def close_navigation(sums: NavigationSums) -> NavigationMetrics:
    """Metrics of a whole run."""

    def root(count: Scalar, totals: Errors) -> Errors:
        roots: Errors = jax.tree.map(
            lambda total: (
                square_root(_mean(total, count, 0.0)) + _mean(0.0 * total, count)
            ),
            totals,
        )
        return roots

    return NavigationMetrics(
        after=root(sums.ticks[0], sums.after),
        steady=root(sums.ticks[1], sums.steady),
        surfacings=sums.surfacings,
        miss=_mean(sums.miss, sums.surfacings),
        miss_share=_mean(sums.miss, sums.ways),
        current_error=_mean(
            sums.current + sums.told * sums.newest, sums.legs + sums.told
        ),
    )


def _mean(total: Scalar, count: Scalar, otherwise: float = jnp.nan) -> Scalar:
    """Total over count, or something else where nothing was counted."""
    none = count <= 0.0
    return jnp.where(none, otherwise, total / jnp.where(none, 1.0, count))
