"""The law that Slocum gliders fly: trim of the battery, and a PID on the fin.

With e = ψ − ψ_d, the fin (or the angle of the moving mass) is told

δ = δ_max clip(−K_p e − K_i ∫e dt − K_d e', ±1),

and stays where it is while |e| and |e'| are within their bands; the integral is held at
zero while the fin is hard over and for a time after. As shipped K_d is negative: it
adds to the turn, and the lag of the glider bears it. Where a mass steers, its angle
changes its sign at each inflection.

The battery goes at once to where the design model is in balance at the wanted pitch and
the ordered ballast, plus a shift learnt on earlier ways down or up; once the pitch has
had time to settle, every so often, where e_θ is outside its band,

Δshift = clip(r_max (K_θ e_θ + K_q e_θ'), ±step).

Source: settings of public flight logs and mission files; the heading law gives back the
fin commands of a flight log to 5e-9 rad. Departures: corrections of the pitch come at
one period, not on a ladder of waiting times, and the memory is the shift itself.
"""

import math

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.balance import trimmed
from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.parts import ANY, gain
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.containers import Flag, Scalar
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.guidance.phases import SURFACE
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
)
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.moving_mass import FinActuation

_SIGN = Interval(-1.0, 1.0, closed_low=True, closed_high=True)


class SlocumState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        integral: ∫e dt [rad s].
        free: time since the fin was hard over [s].
        dive_shift: shift of the battery learnt in dives [m].
        climb_shift: shift learnt in climbs [m].
        waited: time since the pitch was last corrected [s].
        sign: sign of the steering in the tick before, 0 before the first.
    """

    integral: Scalar
    free: Scalar
    dive_shift: Scalar
    climb_shift: Scalar
    waited: Scalar
    sign: Scalar


class Slocum(AbstractController):
    """PID on the heading with a hold, and a battery that is trimmed.

    Attributes:
        model: design model, which the trim is taken from.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        steering_limit: δ_max, largest angle of the fin or the mass [rad].
        dive_sign: sign of the steering in dives, 1 where a positive angle turns the
            glider to starboard, −1 where it turns it to port.
        climb_sign: sign of the steering in climbs. A fin has 1 and 1, a mass that banks
            the glider 1 and −1; `jaxglider trim` tells of others.
        heading_gain: K_p [1/rad].
        heading_integral: K_i [1/(rad s)].
        heading_rate: K_d [s/rad].
        heading_band: |e| within which the fin may stay [rad].
        heading_rate_band: |e'| within which the fin may stay [rad/s].
        integral_wait: time without integral after the fin was hard over [s].
        pitch_gain: K_θ [1/rad].
        pitch_rate: K_q [s/rad].
        position_scale: r_max, move of the battery for an error times gain of one [m].
        largest_step: step, largest correction at once [m].
        pitch_band: |e_θ| within which nothing is corrected [rad].
        pitch_period: time from one correction to the next [s].
        settling: time after an inflection before the first correction [s].

    Raises:
        ValueError: a number is outside its set.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    steering_limit: Scalar = gain(0.425, "rad", Interval(0.0, math.pi), tuned=False)
    dive_sign: Scalar = gain(1.0, "", _SIGN, tuned=False)
    climb_sign: Scalar = gain(1.0, "", _SIGN, tuned=False)
    heading_gain: Scalar = gain(1.5, "1_rad")
    heading_integral: Scalar = gain(0.02, "1_rad_s")
    heading_rate: Scalar = gain(-4.0, "s_rad", ANY)
    heading_band: Scalar = gain(0.087, "rad")
    heading_rate_band: Scalar = gain(0.0087, "rad_s")
    integral_wait: Scalar = gain(120.0, "s")
    pitch_gain: Scalar = gain(3.0, "1_rad")
    pitch_rate: Scalar = gain(1.0, "s_rad")
    position_scale: Scalar = gain(0.036, "m", POSITIVE)
    largest_step: Scalar = gain(0.0051, "m", POSITIVE)
    pitch_band: Scalar = gain(0.0524, "rad")
    pitch_period: Scalar = gain(20.0, "s", POSITIVE)
    settling: Scalar = gain(60.0, "s")

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> "Slocum":
        """The law as shipped, for a fin or for a mass that banks the glider.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, the law has its own.
        """
        turns_mass = not isinstance(model.actuation, FinActuation)
        return cls(model, funnel, climb_sign=-1.0 if turns_mass else 1.0)

    def init(self) -> SlocumState:
        """Nothing learnt, nothing added up."""
        return SlocumState(*(jnp.zeros_like(self.heading_gain) for _ in range(6)))

    def step(
        self,
        state: SlocumState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], SlocumState, ControlRecord]:
        """One run of the law."""
        error, rate = tracking_error(measurement, reference)
        climbing = reference.position.pitch > 0.0
        sign = jnp.where(climbing, self.climb_sign, self.dive_sign)
        fin, integral, free = self._steered(
            state, error.heading, rate.heading, sign, measurement, dt
        )
        dive, climb, waited = self._trimmed(
            state, error.pitch, rate.pitch, climbing, _gliding(reference), dt
        )
        ballast = measurement.applied.buoyancy_mass
        if reference.orders is not None:
            # The mass goes at once to where it will be needed.
            ballast = reference.orders.settled_mass
        trim = trimmed(self.model, reference.position.pitch, ballast)
        wanted = Command(ballast, trim + jnp.where(climbing, climb, dive), fin)
        following = SlocumState(integral, free, dive, climb, waited, sign)
        return wanted, following, ControlRecord(error, error)

    def _steered(
        self,
        state: SlocumState,
        error: Scalar,
        rate: Scalar,
        sign: Scalar,
        measurement: Measurement,
        dt: Scalar,
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Angle of the fin, the integral, and the time since it was hard over."""
        hold = jnp.abs(error) <= self.heading_band
        hold = hold & (jnp.abs(rate) <= self.heading_rate_band)
        asked = -(
            self.heading_gain * error
            + self.heading_integral * state.integral
            + self.heading_rate * rate
        )
        hard = ~hold & (jnp.abs(asked) >= 1.0)
        free = jnp.where(hard, 0.0, state.free + dt)
        added = jnp.where(hold, state.integral, state.integral + error * dt)
        # Before it was ever hard over the time counts from the start: no harm in it.
        integral = jnp.where(free < self.integral_wait, 0.0, added)
        moved = sign * self.steering_limit * jnp.clip(asked, -1.0, 1.0)
        flip = jnp.where(state.sign * sign < 0.0, -1.0, 1.0)
        fin = jnp.where(hold, flip * measurement.applied.mass_angle, moved)
        return fin, integral, free

    def _trimmed(
        self,
        state: SlocumState,
        error: Scalar,
        rate: Scalar,
        climbing: Flag,
        gliding: Scalar,
        dt: Scalar,
    ) -> tuple[Scalar, Scalar, Scalar]:
        """The shifts of dives and climbs, and the time since the last correction."""
        waited = state.waited + dt
        due = (gliding > self.settling) & (waited >= self.pitch_period)
        due = due & (jnp.abs(error) > self.pitch_band)
        push = self.position_scale * (self.pitch_gain * error + self.pitch_rate * rate)
        push = jnp.clip(push, -self.largest_step, self.largest_step)
        step = jnp.where(due, push, 0.0)
        return (
            state.dive_shift + jnp.where(climbing, 0.0, step),
            state.climb_shift + jnp.where(climbing, step, 0.0),
            jnp.where(due, 0.0, waited),
        )


def _gliding(reference: Reference) -> Scalar:
    """Time since the last inflection [s]; none at the surface, where nobody glides."""
    if reference.orders is None:
        return reference.clock
    gliding = reference.orders.phase != SURFACE
    return jnp.where(gliding, reference.clock, 0.0)
