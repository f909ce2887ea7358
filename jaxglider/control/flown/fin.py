"""The heading law of a Slocum: a PID on the fin with a hold and rules for its integral.

Formula, source and departures stand in `slocum`. A run of it is one function of what is
remembered, so that a flight log can be replayed against it.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp

from jaxglider.control.parts import beyond, chosen, either
from jaxglider.core.containers import Flag, Scalar

REVERSAL = 2.96
"""|e| [rad] from which port and starboard are as near: the turn keeps its side."""
NEARLY_OVER = 0.95
"""Share of δ_max from which a fin counts as hard over."""
FORGIVEN = 0.01
"""Share of a run by which times may be off: most are whole numbers of runs, and a
rounding is not to decide whether one more passes."""


class Turning(NamedTuple):
    """Memory of the heading from run to run.

    Attributes:
        error: e of the run before [rad].
        integral: ∫e dt [rad s].
        free: time since the fin came back from being hard over [s].
        asked: share of δ_max that the fin was last told, in [−1, 1].
    """

    error: Scalar
    integral: Scalar
    free: Scalar
    asked: Scalar


class FinGains(NamedTuple):
    """Numbers of the heading law, as fields of `Slocum`.

    Attributes:
        gain: K_p [1/rad].
        integral: K_i [1/(rad s)].
        rate: K_d [s/rad].
        band: |e| within which the fin may stay [rad].
        rate_band: |e'| within which it may [rad/s].
        wait: time without integral after the fin was hard over [s].
    """

    gain: Scalar
    integral: Scalar
    rate: Scalar
    band: Scalar
    rate_band: Scalar
    wait: Scalar


def steered(
    turning: Turning,
    error: Scalar,
    rate: Scalar,
    over: Flag,
    gains: FinGains,
    since: Scalar,
) -> Turning:
    """The memory after a run, with the share of δ_max that the fin is told.

    Args:
        turning: memory before.
        error: e in [−π, π) [rad].
        rate: e' [rad/s].
        over: flag, the fin is hard over.
        gains: numbers of the law.
        since: time since the run before [s].
    """
    crossed = (jnp.abs(error) >= REVERSAL) & (error * turning.error < 0.0)
    error = jnp.where(crossed, error - 2.0 * math.pi * jnp.sign(error), error)
    moves = either(
        beyond(jnp.abs(error), gains.band), beyond(jnp.abs(rate), gains.rate_band)
    )
    told = -(gains.gain * error + gains.integral * turning.integral + gains.rate * rate)
    asked = chosen(moves, jnp.clip(told, -1.0, 1.0), turning.asked)
    # The time counts from the first run that sees the fin back, and what that run and
    # the one that ends the wait see is not added. At the start it counts from there.
    free = jnp.where(over, -since, turning.free + since)
    added = turning.integral + moves * error * since
    waits = turning.free + FORGIVEN * since < gains.wait
    integral = jnp.where(over | waits, 0.0, added)
    return Turning(error, integral, free, asked)
