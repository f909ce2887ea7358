"""Three PIDs around the trim: the law that every other is asked to beat.

With e = η − η_d and the trim (m*, r*) of the wanted glide by the design model,

m_b = m* − K_p e_Z − K_d e_Z' + I_Z,       I_Z' = −K_i e_Z + (m_held − m_asked)/T_t,
r_p = r* + K_p e_θ + K_d e_θ' + I_θ,       I_θ' = K_i e_θ + (r_held − r_asked)/T_t,
a   = −K_p e_ψ − K_d e_ψ' + I_ψ,           I_ψ' = −K_i e_ψ + ν_h/T_t.

Each channel has gains of its own. a is the wanted acceleration of the heading; the
`steering` makes a bank of it and a mass angle of the bank, so that the sign turns round
by itself in a climb, and says what was not carried out, ν_h. The last terms are
anti-windup by back-calculation: while an actuator is at its end or too slow, its
integral follows what it holds. Where a plan orders the ballast, pitch and heading
alone are controlled, at the trim of the ballast that the half is flown with.

Source: N. Mahmoudian and C. Woolsey, VaCAS-2010-2 and IEEE CDC 2008 (trim feedforward
and one PID for each actuator); K. J. Astrom and T. Hagglund, Advanced PID Control
(2006), 3.5 (back-calculation). Assumed: the feedforward is that of a straight glide,
not of their steady turn; the derivative acts on e', as measured.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.balance import wanted_trim
from jaxglider.control.controller import (
    ControlRecord,
    steered_error,
)
from jaxglider.control.parts import gain, wound_back
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import (
    Asked,
    steering_angle,
)
from jaxglider.control.textbook.steered import AbstractSteeredLaw
from jaxglider.core.containers import Scalar
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    zeros,
)


class PIDState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        integral: I of each channel [kg, m, rad/s²].
        asked: wishes of the tick before.
    """

    integral: Channels[Scalar]
    asked: Asked


class PID(AbstractSteeredLaw):
    """Trim feedforward and a PID for each of ballast, mass position and turn.

    Attributes:
        depth_gain: K_p of the depth [kg/m].
        depth_integral: K_i of the depth [kg/(m s)].
        depth_rate: K_d of the depth [kg s/m].
        depth_tracking: T_t of the depth [s].
        pitch_gain: K_p of the pitch [m/rad].
        pitch_integral: K_i of the pitch [m/(rad s)].
        pitch_rate: K_d of the pitch [m s/rad].
        pitch_tracking: T_t of the pitch [s].
        heading_gain: K_p of the heading [1/s²].
        heading_integral: K_i of the heading [1/s³].
        heading_rate: K_d of the heading [1/s].
        heading_tracking: T_t of the heading [s].

    Raises:
        ValueError: a number is outside its set.
    """

    depth_gain: Scalar = gain(0.1, "kg_m")
    depth_integral: Scalar = gain(1e-3, "kg_m_s")
    depth_rate: Scalar = gain(2.5, "kg_s_m")
    depth_tracking: Scalar = gain(40.0, "s", POSITIVE)
    pitch_gain: Scalar = gain(0.015, "m_rad")
    pitch_integral: Scalar = gain(1e-3, "m_rad_s")
    pitch_rate: Scalar = gain(0.1, "m_s_rad")
    pitch_tracking: Scalar = gain(20.0, "s", POSITIVE)
    heading_gain: Scalar = gain(0.01, "1_s2")
    heading_integral: Scalar = gain(5e-5, "1_s3")
    heading_rate: Scalar = gain(0.25, "1_s")
    heading_tracking: Scalar = gain(100.0, "s", POSITIVE)

    def init(self) -> PIDState:
        """Nothing added up, nothing asked for."""
        none = self.depth_gain
        return PIDState(
            zeros(Channels, none), Asked(zeros(Command, none), jnp.zeros_like(none))
        )

    def step(
        self,
        state: PIDState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], PIDState, ControlRecord]:
        """One tick; the integrals are brought up to date before they are used."""
        error, rate = steered_error(self.steering, self.model, measurement, reference)
        integral = self._integral(state, measurement, error, dt)
        trim = wanted_trim(self.model, measurement, reference)
        ballast = trim.buoyancy_mass
        if measurement.buoyancy_mass is None:
            ballast += integral.depth - (
                self.depth_gain * error.depth + self.depth_rate * rate.depth
            )
        position = trim.mass_position + integral.pitch
        position += self.pitch_gain * error.pitch + self.pitch_rate * rate.pitch
        turn = integral.heading - (
            self.heading_gain * error.heading + self.heading_rate * rate.heading
        )
        angle = steering_angle(
            self.steering, self.model, measurement, turn, ballast, self.damping
        )
        wanted = Command(ballast, position, angle)
        following = PIDState(integral, Asked(wanted, turn))
        return wanted, following, ControlRecord(error, rate)

    def _integral(
        self,
        state: PIDState,
        measurement: Measurement,
        error: Channels[Scalar],
        dt: Scalar,
    ) -> Channels[Scalar]:
        """The integrals with the error of this tick, wound back by what was short."""
        added = Channels(
            -self.depth_integral * error.depth,
            self.pitch_integral * error.pitch,
            -self.heading_integral * error.heading,
        )
        short = map_fields(jnp.subtract, measurement.applied, state.asked.command)
        turn = self.steering.shortfall(self.model, measurement, state.asked).heading
        shorts = Channels(short.buoyancy_mass, short.mass_position, turn)
        times = Channels(
            self.depth_tracking, self.pitch_tracking, self.heading_tracking
        )
        return map_fields(
            lambda i, a, s, t: wound_back(i, a, s, t, dt),
            state.integral,
            added,
            shorts,
            times,
        )
