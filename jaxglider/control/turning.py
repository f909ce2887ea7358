"""The turn of a glider under the water: the model behind steering by bank.

The weight of the moving mass has no moment about the vertical, for r × W is level. So
the mass cannot turn the glider. It rolls it; the lift of the rolled glider pushes it
sideways, and the water turns what slips. With H the angular momentum about the
vertical and J the inertia about it,

H = −I₁ p sinθ + cosθ (I₂ q sinφ + I₃ r cosφ),
J = I₁ sin²θ + cos²θ (I₂ sin²φ + I₃ cos²φ),
Ω = H/J,   Ω' = τ/J,

τ the vertical component of the water's moment. In a steady turn Ω = ψ'. A compass sees
more: while a glider rolls its heading swings, and swings back when the roll does. Ω
does not see that. For small sideslip v and bank φ,

v' = −a v + … + b φ,   Ω' = c v − e Ω + f φ,

b from the weight, f from the water's pitching moment, which a rolled glider has about
the vertical. With the slip eliminated, Ω'' = −T Ω' − D Ω + N φ, T = a + e and
N = c b + a f.

The lift carries the net weight of the ballast, which is known, and b is its share
across: g m_b cosθ/m₂. The angle of attack is that of the steady glide of this pitch and
speed. So N has the sign of what the ballast does, and neither a passing heave nor the
heave of the turn itself goes in. Where a mass angle yaws the glider one way at once and
turns it the other way in the end, a bank does not.

Source: Newton's laws on the design model; own derivation.
"""

import equinox as eqx
import jax

from jaxglider.core.containers import Scalar
from jaxglider.signals import Measurement
from jaxglider.vehicle.design_model import DesignModel

LEVEL = 0.05
"""Sine of a pitch below which a glider counts as level, with no lift to turn it."""


class TurnModel(eqx.Module):
    """The turn at one instant, and what a bank does to it.

    Attributes:
        rate: Ω [rad/s].
        response: N [1/s³], per radian of bank.
        damping: T [1/s].
    """

    rate: Scalar
    response: Scalar
    damping: Scalar


@jax.named_scope("turn_model")
def turn_model(model: DesignModel, measurement: Measurement) -> TurnModel:
    """The turn of a glider as its design model has it.

    Args:
        model: design model.
        measurement: measured state of the glider.
    """
    c, a, nu = model.parameters, measurement.attitude, measurement.state.velocity()
    u, speed = nu.surge, abs(nu.surge)
    m1, m2, m3 = c.surge_mass, c.sway_mass, c.heave_mass
    # The vertical in the body frame.
    x, y, z = -a.sin_pitch, a.cos_pitch * a.sin_roll, a.cos_pitch * a.cos_roll
    momentum = (
        c.roll_inertia * nu.roll * x
        + c.pitch_inertia * nu.pitch * y
        + c.yaw_inertia * nu.yaw * z
    )
    inverse = 1.0 / (
        c.roll_inertia * x * x + c.pitch_inertia * y * y + c.yaw_inertia * z * z
    )
    cotangent = a.cos_pitch * a.sin_pitch / (a.sin_pitch * a.sin_pitch + LEVEL * LEVEL)
    weight = c.gravity * measurement.applied.buoyancy_mass * a.cos_pitch
    w = -u * (c.drag * cotangent + c.lift_offset) / (c.drag + c.lift_slope)
    pitching = c.pitch_moment_offset * u * u + w * (
        c.pitch_moment_slope * speed + (m3 - m1) * u
    )
    slip_damping = (c.drag - c.side_force_slope) * speed / m2
    turn_damping = -(
        c.yaw_damping * a.cos_pitch * a.cos_pitch
        + c.roll_damping * a.sin_pitch * a.sin_pitch
    )
    turn_by_slip = a.cos_pitch * (c.yaw_moment_slope * speed + (m1 - m2) * u)
    turn_by_slip -= a.sin_pitch * (c.roll_moment_slope * speed + (m2 - m3) * w)
    return TurnModel(
        rate=inverse * momentum,
        response=inverse
        * (slip_damping * a.cos_pitch * pitching + turn_by_slip * weight / m2),
        damping=slip_damping + inverse * turn_damping * u * u,
    )
