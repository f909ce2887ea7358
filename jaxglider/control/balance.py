"""Balance of a straight glide by the design model: where the trim of a law comes from.

Along the path drag carries the net weight, K_D0 V² = −m_b g sin ξ, and across it the
lift carries the rest, K_L0 + K_L α = −K_D0 cot ξ, small angles of attack throughout.
With ξ = θ − α that gives α from the pitch alone, a few times over. The moments are then
in balance at that α and V.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645, on the paper's design model.
"""

import dataclasses

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import sincos, square_root
from jaxglider.signals import Command, GliderState, Measurement, Reference, zeros
from jaxglider.vehicle.design_model import DesignModel

FLATTEST = 0.1
"""Pitch [rad] below which angle of attack and moments are those of this pitch."""
FLATTEST_PATH = 0.2
"""Angle of a path [rad] below which the ballast is that of this path."""
_MOST_ATTACK = 0.2
_ROUNDS = 4


def _steep(pitch: Scalar) -> Scalar:
    """The pitch, at least `FLATTEST` down or up."""
    return jnp.where(pitch < 0.0, -1.0, 1.0) * jnp.maximum(jnp.abs(pitch), FLATTEST)


def angle_of_attack(model: DesignModel, pitch: Scalar) -> Scalar:
    """α [rad] of a straight glide of a pitch: α = −(K_D0 cot(θ − α) + K_L0)/K_L.

    Args:
        model: design model.
        pitch: θ [rad].
    """
    c, steep = model.parameters, _steep(pitch)
    alpha = jnp.zeros_like(pitch)
    for _ in range(_ROUNDS):
        sine, cosine = sincos(steep - alpha)
        alpha = -(c.drag * cosine / sine + c.lift_offset) / c.lift_slope
        alpha = jnp.clip(alpha, -_MOST_ATTACK, _MOST_ATTACK)
    return alpha


def trim_ballast(
    model: DesignModel, pitch: Scalar, alpha: Scalar, depth_rate: Scalar
) -> Scalar:
    """Ballast that glides down or up at a depth rate: −K_D0 V²/(g sin ξ) [kg].

    V = |Z'|/|sin ξ|; the pitch says whether it sinks or rises, whichever way the depth
    is to go. Paths flatter than `FLATTEST_PATH` count as that steep.

    Args:
        model: design model.
        pitch: θ [rad].
        alpha: α [rad].
        depth_rate: Z' [m/s]; its modulus counts.
    """
    c, down = model.parameters, jnp.where(pitch < 0.0, -1.0, 1.0)
    path = jnp.maximum(down * (pitch - alpha), FLATTEST_PATH)
    sine = down * sincos(path)[0]
    return -c.drag * depth_rate * depth_rate / (c.gravity * sine * sine * sine)


@jax.named_scope("trim")
def trim_position(
    model: DesignModel, pitch: Scalar, buoyancy_mass: Scalar, alpha: Scalar
) -> Scalar:
    """Position of the moving mass in a straight glide of a pitch and a ballast [m].

    The moments in balance at V² = −m_b g sin ξ/K_D0. A ballast that cannot glide so
    balances at rest.

    Args:
        model: design model.
        pitch: θ [rad].
        buoyancy_mass: m_b [kg].
        alpha: α [rad].
    """
    c = model.parameters
    squared = -buoyancy_mass * c.gravity * sincos(_steep(pitch) - alpha)[0] / c.drag
    speed = square_root(jnp.maximum(squared, 0.0))
    sine, cosine = sincos(alpha)
    state = dataclasses.replace(
        zeros(GliderState, pitch),
        pitch=pitch,
        surge=speed * cosine,
        heave=speed * sine,
    )
    attitude = state.attitude()
    still = zeros(Command, pitch)
    command = Command(buoyancy_mass, still.mass_position, still.mass_angle)
    moment = model.force(state, attitude, command).pitch
    gain = model.actuation.effectiveness(c, attitude, still.mass_angle)
    return -moment / gain.pitch_position


def wanted_trim(
    model: DesignModel, measurement: Measurement, reference: Reference
) -> Command[Scalar]:
    """Ballast and position of the straight glide that is wanted; angle zero [kg, m].

    The ballast is the one that is ordered, that of the whole half: the mass goes at
    once to where it will be needed. Where none is, it is that of the wanted depth rate.

    Args:
        model: design model.
        measurement: everything that may be known of the glider.
        reference: wanted outputs with their rates.
    """
    pitch = reference.position.pitch
    alpha = angle_of_attack(model, pitch)
    if reference.orders is not None:
        ballast = reference.orders.settled_mass
    elif measurement.buoyancy_mass is not None:
        ballast = measurement.buoyancy_mass
    else:
        ballast = trim_ballast(model, pitch, alpha, reference.rate.depth)
    position = trim_position(model, pitch, ballast, alpha)
    return Command(ballast, position, jnp.zeros_like(position))
