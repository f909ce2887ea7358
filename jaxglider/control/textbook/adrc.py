"""Active disturbance rejection: one observer takes everything for a disturbance.

Each channel is y'' = f + b₀ u, f all that is not known. An extended state observer has
y, y' and f as its states, all poles at −ω_o; its estimates z take f away and place the
poles of what is left at −ω_c:

b₀ u = ω_c² (y_d − z₁) + 2 ω_c (y_d' − z₂) + y_d'' − z₃.

Discrete, for a tick Δt and u held: with ẑ the prediction by y'' = z₃ + b₀ u,

z = ẑ + L (y − ẑ₁),   L = [1 − β³, 3/2 (1 − β)² (1 + β)/Δt, (1 − β)³/Δt²],

β = e^{−ω_o Δt}, so that the error of the estimate has its three poles at β. u is what
the actuators hold, so that nothing winds up. Ballast acts on the depth, the place of
the mass on the pitch; the heading's u is the turn that the `steering` carries out.

Source: Z. Gao, American Control Conference 2003 (bandwidth form); R. Miklosovic,
A. Radke and Z. Gao, ACC 2006 (discrete observer); for gliders D. Song et al., 2017.
Assumed: b₀ are constants, those of the design model in a dive of the paper. Theory
wants ω_o of 3 to 10 ω_c, and b₀ within a factor of 2.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.controller import (
    ControlRecord,
    tracking_error,
)
from jaxglider.control.parts import gain
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import (
    INVERSION,
    AbstractSteering,
    Asked,
    steering_angle,
)
from jaxglider.control.textbook.steered import AbstractSteeredLaw
from jaxglider.core.containers import Flag, Scalar
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    map_fields,
    zeros,
)
from jaxglider.vehicle.design_model import DesignModel

_PITCH = -0.8
"""Pitch of the dive that b₀ is taken at [rad]."""


class Extended(eqx.Module):
    """Estimates of one channel.

    Attributes:
        value: z₁ [m or rad].
        rate: z₂ [m/s or rad/s].
        disturbance: z₃ [m/s² or rad/s²].
    """

    value: Scalar
    rate: Scalar
    disturbance: Scalar


class ADRCState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        estimates: z of each channel.
        asked: wishes of the tick before.
        begun: 1 after the first tick, which takes over what is measured.
    """

    estimates: Channels[Extended]
    asked: Asked
    begun: Scalar


class ADRC(AbstractSteeredLaw):
    """Three extended state observers, and a pole placed in each channel.

    Attributes:
        control: ω_c of each channel [rad/s].
        observer: ω_o of each channel [rad/s].
        depth_input: b₀ of the depth, acceleration downward per ballast [m/(s² kg)].
        pitch_input: −b₀ of the pitch, nose-down per forward place [rad/(s² m)].
        heading_input: b₀ of the heading, turn carried out per turn asked for.

    Raises:
        ValueError: a number is not positive.
    """

    control: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.08, 0.25, 0.06), metadata={"set": POSITIVE}
    )
    observer: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.4, 1.2, 0.25), metadata={"set": POSITIVE}
    )
    depth_input: Scalar = gain(0.08, "m_s2_kg", POSITIVE)
    pitch_input: Scalar = gain(3.0, "rad_s2_m", POSITIVE)
    heading_input: Scalar = gain(1.0, "", POSITIVE)

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering = INVERSION,
    ) -> "ADRC":
        """The law with b₀ of the design model, and bandwidths by hand.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer.
        """
        zero = jnp.zeros_like(model.parameters.drag)
        state = dataclasses.replace(zeros(GliderState, zero), pitch=zero + _PITCH)
        still = Measurement(
            state, state.attitude(), zeros(Command, zero), zeros(BodyAxes, zero)
        )
        g = model.input_gain(still)
        return cls(
            model,
            funnel,
            depth_input=g.depth_buoyancy,
            pitch_input=-g.pitch_position,
            steering=steering,
        )

    def init(self) -> ADRCState:
        """Nothing estimated."""
        zero = jnp.zeros_like(self.depth_input)
        one = Extended(zero, zero, zero)
        asked = Asked(zeros(Command, zero), zero)
        return ADRCState(Channels(one, one, one), asked, zero)

    def step(
        self,
        state: ADRCState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], ADRCState, ControlRecord]:
        """One tick: estimates first, then the command by them."""
        error, rate = tracking_error(measurement, reference)
        estimates = self.estimated(state, measurement, dt)
        wanted = map_fields(_placed, self.control, estimates, reference_of(reference))
        ballast = wanted.depth / self.depth_input
        if measurement.buoyancy_mass is not None:
            ballast = measurement.buoyancy_mass
        turn = wanted.heading / self.heading_input
        angle = steering_angle(
            self.steering, self.model, measurement, turn, ballast, self.damping
        )
        command = Command(ballast, -wanted.pitch / self.pitch_input, angle)
        one = jnp.ones_like(state.begun)
        following = ADRCState(estimates, Asked(command, turn), one)
        return command, following, ControlRecord(error, rate)

    def estimated(
        self, state: ADRCState, measurement: Measurement, dt: Scalar
    ) -> Channels[Extended]:
        """z of each channel with the measurement of this tick.

        Args:
            state: memory of the tick before.
            measurement: everything that may be known of the glider.
            dt: tick [s].
        """
        held, s = measurement.applied, measurement.state
        missed = self.steering.shortfall(self.model, measurement, state.asked)
        pushed = Channels(
            self.depth_input * held.buoyancy_mass,
            -self.pitch_input * held.mass_position,
            self.heading_input * (state.asked.turn + missed.heading),
        )
        seen = Channels(s.depth, s.pitch, s.heading)
        angles = Channels(False, True, True)
        first = state.begun < 0.5
        return map_fields(
            lambda z, b0u, y, w, angle: _observed(z, b0u, y, w, angle, first, dt),
            state.estimates,
            pushed,
            seen,
            self.observer,
            angles,
        )


class _Wanted(eqx.Module):
    """y_d, y_d', y_d'' of one channel, and whether it is an angle."""

    value: Scalar
    rate: Scalar
    acceleration: Scalar
    angle: bool = eqx.field(static=True)


def reference_of(reference: Reference) -> Channels[_Wanted]:
    """Wanted value, rate and acceleration of each channel.

    Args:
        reference: wanted outputs with their rates and accelerations.
    """
    angles = Channels(False, True, True)
    return map_fields(
        _Wanted, reference.position, reference.rate, reference.acceleration, angles
    )


def _placed(control: Scalar, z: Extended, wanted: _Wanted) -> Scalar:
    """b₀ u of one channel [m/s² or rad/s²]."""
    left = wanted.value - z.value
    left = wrap(left) if wanted.angle else left
    return (
        control * (control * left + 2.0 * (wanted.rate - z.rate))
        + wanted.acceleration
        - z.disturbance
    )


def observer_gains(bandwidth: Scalar, dt: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """L of an observer with its three poles at e^{−ω_o Δt} [1, 1/s, 1/s²].

    Args:
        bandwidth: ω_o [rad/s].
        dt: tick [s].
    """
    beta = jnp.exp(-bandwidth * dt)
    short = 1.0 - beta
    return (
        1.0 - beta * beta * beta,
        1.5 * short * short * (1.0 + beta) / dt,
        short * short * short / (dt * dt),
    )


def _observed(
    z: Extended,
    pushed: Scalar,
    seen: Scalar,
    bandwidth: Scalar,
    angle: bool,
    first: Flag,
    dt: Scalar,
) -> Extended:
    """z after a measurement; at the first it takes over what is seen."""
    acceleration = z.disturbance + pushed
    value = z.value + dt * (z.rate + 0.5 * dt * acceleration)
    rate = z.rate + dt * acceleration
    missed = wrap(seen - value) if angle else seen - value
    l1, l2, l3 = observer_gains(bandwidth, dt)
    return Extended(
        jnp.where(first, seen, value + l1 * missed),
        jnp.where(first, 0.0, rate + l2 * missed),
        jnp.where(first, 0.0, z.disturbance + l3 * missed),
    )
