"""The turns of a Seaglider: from stop to stop, about a centre that is learnt.

Formula, source and assumptions stand in `seaglider`.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jaxglider.control.parts import beyond
from jaxglider.core.containers import Flag, Scalar


class Roll(NamedTuple):
    """Memory of the turns.

    Attributes:
        turn: side of the heading error that a turn is on for, 0 for no turn.
        turning: time since the turn began [s].
        dive_centre: γ₀ in dives [rad].
        climb_centre: γ₀ in climbs [rad].
    """

    turn: Scalar
    turning: Scalar
    dive_centre: Scalar
    climb_centre: Scalar

    def centre(self, climbing: Flag) -> Scalar:
        """γ₀ of climbs or of dives [rad]."""
        return jnp.where(climbing, self.climb_centre, self.dive_centre)


class RollGains(NamedTuple):
    """Numbers of the turns, as fields of `Seaglider`.

    Attributes:
        heading_band: |e_ψ| that is left alone [rad].
        longest_turn: longest time of a turn [s].
        centre_gain: k₀ [s].
        centre_band: |ψ'| within which the centre is left alone [rad/s].
    """

    heading_band: Scalar
    longest_turn: Scalar
    centre_gain: Scalar
    centre_band: Scalar


def ended(roll: Roll, error: Scalar, gains: RollGains, dt: Scalar) -> Roll:
    """The memory with a turn ended that has done its work, or has lasted enough.

    Args:
        roll: memory of the tick before.
        error: e_ψ [rad].
        gains: numbers of the turns.
        dt: tick [s].
    """
    over = (error * roll.turn <= 0.0) | (roll.turning >= gains.longest_turn)
    turn = jnp.where(over, 0.0, roll.turn)
    return roll._replace(
        turn=turn, turning=jnp.where(turn == 0.0, 0.0, roll.turning + dt)
    )


def begun(
    roll: Roll,
    error: Scalar,
    turn_rate: Scalar,
    climbing: Flag,
    sign: Scalar,
    gains: RollGains,
) -> Roll:
    """The memory after a look: a turn if it takes one, the centre trimmed if none was.

    Args:
        roll: memory before.
        error: e_ψ [rad].
        turn_rate: ψ' [rad/s].
        climbing: flag, the glider is to climb.
        sign: sign of the turn by a positive angle.
        gains: numbers of the turns.
    """
    still = jnp.where(roll.turn == 0.0, 1.0, 0.0).astype(turn_rate.dtype)
    still *= beyond(jnp.abs(turn_rate), gains.centre_band)
    step = -sign * still * gains.centre_gain * turn_rate
    return Roll(
        turn=beyond(jnp.abs(error), gains.heading_band) * jnp.sign(error),
        turning=jnp.zeros_like(roll.turning),
        dive_centre=roll.dive_centre + jnp.where(climbing, 0.0, step),
        climb_centre=roll.climb_centre + jnp.where(climbing, step, 0.0),
    )
