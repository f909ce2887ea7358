"""The law that Slocum gliders fly: trim of the battery, and a PID on the fin.

It runs once in a cycle of 4 s. With e = ψ − ψ_d, the fin (or the angle of the moving
mass) is told

δ = δ_max clip(−K_p e − K_i ∫e dt − K_d e', ±1),

e' by the difference of two cycles. While |e| and |e'| are within their bands the fin
stays where it is and the integral as it is; the integral is zero from when the fin is
hard over until a time after. About ±180° the turn goes on to the side it is on. As
shipped K_d is negative: it adds to the turn, and the lag of the glider bears it. Where
a mass steers, its angle changes its sign at each inflection.

The battery goes at once to where the design model is in balance at the wanted pitch and
the ordered ballast, plus a shift. Once the pitch has had time to settle it is looked at
now and then: outside its band

Δshift = clip(r_max (K_θ e_θ + K_q e_θ'), ±step),

inside the wait to the next look doubles. A new dive or climb begins with the mean shift
that had the pitch inside its band on the last one of its kind, if that was seen often
enough. Where no plan orders the ballast it comes from a table of speeds, here that of
the design model, and a depth hold.

Source: settings of public flight logs and mission files; the heading law gives back the
fin commands of a flight log to 1e-8 rad, its holds included. Departures: the wait after
a correction is a number of its own, not half of an expected time; shifts are
remembered, not positions, so that they hold for another pitch too.
"""

import math

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.balance import wanted_trim
from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.flown.battery import Looks, Shifts, looked, remembered
from jaxglider.control.flown.fin import (
    FORGIVEN,
    NEARLY_OVER,
    FinGains,
    Turning,
    steered,
)
from jaxglider.control.parts import (
    ANY,
    SIGN,
    gain,
    is_due,
    replaced,
    sampled_rate,
)
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.containers import Flag, Scalar
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.guidance.phases import SURFACE
from jaxglider.signals import Channels, Command, Measurement, Reference, zeros
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.moving_mass import FinActuation


class SlocumState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        elapsed: time since the law last ran [s].
        runs: 1 once it has run, else 0.
        turning: memory of the heading.
        pitch_error: e_θ of the run before [rad].
        shifts: shifts of the battery, and the looks at the pitch.
        climbed: 1 where the half of the last run is a climb, else 0.
        command: command of the last run [kg, m, rad].
    """

    elapsed: Scalar
    runs: Scalar
    turning: Turning
    pitch_error: Scalar
    shifts: Shifts
    climbed: Scalar
    command: Command[Scalar]


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
        pitch_period: time from a correction to the next look [s].
        longest_wait: longest time from one look at the pitch to the next [s].
        settling: time after an inflection before the first correction [s].
        depth_gain: ballast per error of the depth [kg/m], where no plan orders it.
        depth_rate: ballast per error of the depth rate [kg s/m], likewise.
        cycle: time from one run to the next [s]; the tick where that is longer.

    Raises:
        ValueError: a number is outside its set.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    steering_limit: Scalar = gain(0.425, "rad", Interval(0.0, math.pi), tuned=False)
    dive_sign: Scalar = gain(1.0, "", SIGN, tuned=False)
    climb_sign: Scalar = gain(1.0, "", SIGN, tuned=False)
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
    longest_wait: Scalar = gain(60.0, "s", POSITIVE, tuned=False)
    settling: Scalar = gain(60.0, "s")
    depth_gain: Scalar = gain(0.001, "kg_m")
    depth_rate: Scalar = gain(0.001, "kg_s_m")
    cycle: Scalar = gain(4.0, "s", POSITIVE, tuned=False)

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> "Slocum":
        """The law as shipped for a fin, or for a battery that banks the glider.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, the law has its own.
        """
        if isinstance(model.actuation, FinActuation):
            return cls(model, funnel)
        rolling = {"heading_gain": 1.0, "heading_integral": 0.03, "heading_rate": 0.0}
        return cls(model, funnel, climb_sign=-1.0, **rolling)

    def cycle_time(self) -> Scalar:
        """Time from one run to the next [s]."""
        return self.cycle

    def init(self) -> SlocumState:
        """Nothing learnt, nothing added up; it runs in the first tick."""
        zero = jnp.zeros_like(self.cycle)
        return SlocumState(
            elapsed=zero,
            runs=zero,
            turning=Turning(zero, zero, zero, zero),
            pitch_error=zero,
            shifts=Shifts(zero, zero, zero, zero, zero, zero),
            climbed=zero,
            command=zeros(Command, zero),
        )

    def step(
        self,
        state: SlocumState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], SlocumState, ControlRecord]:
        """One tick: a run of the law, or what its last run told."""
        error, rate = tracking_error(measurement, reference)
        first = state.runs < 0.5
        since = jnp.where(first, dt, state.elapsed)
        ran = self._run(state, measurement, reference, error, rate, first, since)
        due = first | is_due(state.elapsed, self.cycle, dt)
        following: SlocumState = replaced(due, ran, state)
        elapsed = jnp.where(due, 0.0, state.elapsed) + dt
        following = eqx.tree_at(lambda s: s.elapsed, following, elapsed)
        return following.command, following, ControlRecord(error, error)

    def _run(
        self,
        state: SlocumState,
        measurement: Measurement,
        reference: Reference,
        error: Channels[Scalar],
        rate: Channels[Scalar],
        first: Flag,
        since: Scalar,
    ) -> SlocumState:
        """The memory after a run, with the command."""
        climbing = reference.position.pitch > 0.0
        climbed = jnp.where(first, climbing, state.climbed > 0.5)
        turned = (climbing != climbed) | first
        held = measurement.applied.mass_angle
        turning = steered(
            state.turning,
            error.heading,
            sampled_rate(error.heading, state.turning.error, since, first),
            jnp.abs(held) >= NEARLY_OVER * self._most(reference),
            self.fin_gains(),
            since,
        )
        looks = Looks(self.pitch_band, self.pitch_period, self.longest_wait)
        shifts = remembered(state.shifts, climbed, turned, looks)
        pitch_rate = sampled_rate(error.pitch, state.pitch_error, since, turned)
        push = self.pitch_gain * error.pitch + self.pitch_rate * pitch_rate
        push = jnp.clip(
            self.position_scale * push, -self.largest_step, self.largest_step
        )
        settled = _gliding(reference) > self.settling + FORGIVEN * since
        shifts = looked(shifts, error.pitch, push, climbing, settled, looks, since)
        trim = wanted_trim(self.model, measurement, reference)
        ballast = trim.buoyancy_mass
        if reference.orders is None:
            ballast -= self.depth_gain * error.depth + self.depth_rate * rate.depth
        sign = jnp.where(climbing, self.climb_sign, self.dive_sign)
        fin = sign * self.steering_limit * turning.asked
        return SlocumState(
            elapsed=state.elapsed,
            runs=jnp.ones_like(state.runs),
            turning=turning,
            pitch_error=error.pitch,
            shifts=shifts,
            climbed=climbing.astype(state.climbed.dtype),
            command=Command(ballast, trim.mass_position + shifts.at(climbing), fin),
        )

    def _most(self, reference: Reference) -> Scalar:
        """Angle of a fin that is hard over [rad], less where the plan limits it."""
        orders = reference.orders
        if orders is None or orders.steering_limit is None:
            return self.steering_limit
        return jnp.minimum(self.steering_limit, orders.steering_limit)

    def fin_gains(self) -> FinGains:
        """The numbers of the heading law."""
        return FinGains(
            self.heading_gain,
            self.heading_integral,
            self.heading_rate,
            self.heading_band,
            self.heading_rate_band,
            self.integral_wait,
        )


def _gliding(reference: Reference) -> Scalar:
    """Time since the last inflection [s]; none at the surface, where nobody glides."""
    if reference.orders is None:
        return reference.clock
    gliding = reference.orders.phase != SURFACE
    return jnp.where(gliding, reference.clock, 0.0)
