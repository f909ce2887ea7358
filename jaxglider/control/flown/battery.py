"""The pitch servo of a Slocum: when it looks, what it learns, what it remembers.

A look that finds the pitch outside its band moves the battery and waits; one that finds
it inside waits twice as long as the last time, up to a longest wait. All runs that find
it inside count for the mean, and a half seen so `ENOUGH` times leaves its mean to the
next one of its kind.

Source: settings of public flight logs; waits of 2, 4, 8, 16, 32 and 60 s stand in two.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.parts import beyond, chosen, is_due
from jaxglider.core.containers import Flag, Scalar

ENOUGH = 5.0
"""Number of runs inside the band from which their mean is remembered."""


class Shifts(eqx.Module):
    """Shifts of the battery from the trim of the model, and the looks at the pitch.

    Attributes:
        dive: shift in dives [m].
        climb: shift in climbs [m].
        total: sum of the shifts of this half that had the pitch in its band [m].
        count: number of them.
        waited: time since the last look [s].
        wait: time to the next [s].
    """

    dive: Scalar
    climb: Scalar
    total: Scalar
    count: Scalar
    waited: Scalar
    wait: Scalar

    def at(self, climbing: Flag) -> Scalar:
        """The shift of climbs or of dives [m]."""
        return jnp.where(climbing, self.climb, self.dive)


class Looks(NamedTuple):
    """Settings of the looks at the pitch.

    Attributes:
        band: |e_θ| within which nothing is corrected [rad].
        wait: time from a correction to the next look [s].
        longest: longest time from one look to the next [s].
    """

    band: Scalar
    wait: Scalar
    longest: Scalar


def remembered(shifts: Shifts, climbed: Flag, turned: Flag, looks: Looks) -> Shifts:
    """The shifts at the start of a run; after an inflection with the mean of that half.

    Args:
        shifts: shifts after the run before.
        climbed: flag, the half that is over or still on is a climb.
        turned: flag, this run is the first of another half.
        looks: settings of the looks.
    """
    mean = shifts.total / jnp.maximum(shifts.count, 1.0)
    known = turned & (shifts.count >= ENOUGH)
    return Shifts(
        jnp.where(known & ~climbed, mean, shifts.dive),
        jnp.where(known & climbed, mean, shifts.climb),
        jnp.where(turned, 0.0, shifts.total),
        jnp.where(turned, 0.0, shifts.count),
        shifts.waited,
        jnp.where(turned, looks.wait, shifts.wait),
    )


def looked(
    shifts: Shifts,
    error: Scalar,
    push: Scalar,
    climbing: Flag,
    settled: Flag,
    looks: Looks,
    dt: Scalar,
) -> Shifts:
    """The shifts after a run.

    Args:
        shifts: shifts at its start.
        error: e_θ [rad].
        push: correction that this run would make [m].
        climbing: flag, the glider is to climb.
        settled: flag, the pitch has had time to settle.
        looks: settings of the looks.
        dt: time from one run to the next [s].
    """
    outside = beyond(jnp.abs(error), looks.band)
    looks_now = settled & is_due(shifts.waited + dt, shifts.wait, dt)
    added = jnp.where(looks_now, outside * push, 0.0)
    after = shifts.at(climbing) + added
    inside = jnp.where(settled & (jnp.abs(error) <= looks.band), 1.0, 0.0)
    inside = inside.astype(push.dtype)
    doubled = jnp.minimum(2.0 * shifts.wait, jnp.maximum(looks.longest, looks.wait))
    following = chosen(outside, looks.wait, doubled)
    return Shifts(
        jnp.where(climbing, shifts.dive, after),
        jnp.where(climbing, after, shifts.climb),
        shifts.total + inside * after,
        shifts.count + inside,
        jnp.where(looks_now, 0.0, shifts.waited + dt),
        jnp.where(looks_now, following, shifts.wait),
    )
