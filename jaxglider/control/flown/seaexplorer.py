"""The law that SeaExplorers fly: a PID of the heading on the rolling mass.

It runs every 20 s. With e = ψ − ψ_d, for the first two terms zero inside a dead zone
and cut off at a largest error, and e' by the difference of two runs,

γ = σ clip(−K_p e − K_i ∫e dt − K_d e', ±γ_max),

σ = 1 in dives and −1 in climbs, where a bank turns the other way, and the integral's
share limited. The pitch has no loop: at the start of each phase the mass goes to the
place where the design model is in balance at the wanted pitch, plus an offset that the
pilot gives for dives and for climbs; newer ones add K_θ e_θ.

Source: the vendor's settings and flight logs of three gliders: K_p 0.2, K_i 0.002,
K_d 15 s, 15 deg for the largest error and for the integral's share, ±45 deg, dead zone
2 deg. Assumed: the derivative sees the whole error; the limit of the integral is that
of its share of the angle; runs come every 20 s at inflections too, where the glider
makes them every 10 s. Where no plan orders the ballast it is the design model's.
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
from jaxglider.control.parts import (
    ANY,
    BEFORE,
    SIGN,
    Phase,
    beyond,
    gain,
    has_changed,
    is_due,
    phase_of,
    replaced,
    sampled_rate,
)
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import saturate
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    zeros,
)
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.moving_mass import FinActuation

_OFFSET = Interval(-0.1, 0.1)
_PITCH_GAIN = Interval(-0.5, 0.5)  # both signs: a search that begins at 0 can leave it


class SeaExplorerState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        elapsed: time since the law last ran [s].
        phase: phase at the tick before; before the first its clock is `BEFORE`.
        error: e of the run before [rad].
        integral: ∫e dt [rad s].
        place: place of the mass without feedback [m].
        command: command of the last run [kg, m, rad].
    """

    elapsed: Scalar
    phase: Phase
    error: Scalar
    integral: Scalar
    place: Scalar
    command: Command[Scalar]


class SeaExplorer(AbstractController):
    """PID of the heading on the rolling mass, and a place of the mass for each phase.

    Attributes:
        model: design model, which the places of the mass are taken from.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        heading_gain: K_p.
        heading_integral: K_i [1/s].
        heading_rate: K_d [s].
        dead_zone: |e| that counts as none [rad].
        largest_error: |e| that larger ones count as [rad].
        integral_limit: largest share of the integral in the angle [rad].
        largest_angle: γ_max [rad].
        dive_sign: σ in dives, 1 where a positive angle turns the glider to starboard.
        climb_sign: σ in climbs.
        dive_offset: shift that the pilot adds to the place of the mass in dives [m].
        climb_offset: shift that the pilot adds to it in climbs [m].
        pitch_gain: K_θ, move of the mass for an error of the pitch [m/rad]; 0 as most
            are flown.
        period: time from one run to the next [s].

    Raises:
        ValueError: a number is outside its set.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    heading_gain: Scalar = gain(0.2, "")
    heading_integral: Scalar = gain(0.002, "1_s")
    heading_rate: Scalar = gain(15.0, "s", ANY)
    dead_zone: Scalar = gain(math.radians(2.0), "rad")
    largest_error: Scalar = gain(math.radians(15.0), "rad", POSITIVE)
    integral_limit: Scalar = gain(math.radians(15.0), "rad", POSITIVE)
    largest_angle: Scalar = gain(
        math.radians(45.0), "rad", Interval(0.0, math.pi / 2), tuned=False
    )
    dive_sign: Scalar = gain(1.0, "", SIGN, tuned=False)
    climb_sign: Scalar = gain(-1.0, "", SIGN, tuned=False)
    dive_offset: Scalar = gain(0.0, "m", _OFFSET)
    climb_offset: Scalar = gain(0.0, "m", _OFFSET)
    pitch_gain: Scalar = gain(0.0, "m_rad", _PITCH_GAIN)
    period: Scalar = gain(20.0, "s", POSITIVE, tuned=False)

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> "SeaExplorer":
        """The law as shipped.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, the law has its own.
        """
        fin = isinstance(model.actuation, FinActuation)
        return cls(model, funnel, climb_sign=1.0 if fin else -1.0)

    def cycle_time(self) -> Scalar:
        """Time from one run to the next [s]."""
        return self.period

    def init(self) -> SeaExplorerState:
        """Nothing added up; the first tick begins a phase."""
        zero = jnp.zeros_like(self.period)
        phase = Phase(zero, zero + BEFORE)
        command = zeros(Command, zero)
        return SeaExplorerState(zero, phase, zero, zero, zero, command)

    def step(
        self,
        state: SeaExplorerState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], SeaExplorerState, ControlRecord]:
        """One tick: a run of the law, or what its last run told."""
        error, _ = tracking_error(measurement, reference)
        phase = phase_of(reference)
        changed = has_changed(state.phase, phase)
        due = changed | is_due(state.elapsed, self.period, dt)
        first = state.phase.clock == BEFORE
        since = jnp.maximum(state.elapsed, dt)
        climbing = reference.position.pitch > 0.0
        shut = beyond(jnp.abs(error.heading), self.dead_zone)
        e = saturate(shut * error.heading, self.largest_error)
        rate = sampled_rate(error.heading, state.error, since, first)
        most = self.integral_limit / jnp.maximum(self.heading_integral, 1e-9)
        integral = saturate(state.integral + since * e, most)
        asked = self.heading_gain * e + self.heading_rate * rate
        asked += self.heading_integral * integral
        sign = jnp.where(climbing, self.climb_sign, self.dive_sign)
        trim = wanted_trim(self.model, measurement, reference)
        offset = jnp.where(climbing, self.climb_offset, self.dive_offset)
        place = jnp.where(changed, trim.mass_position + offset, state.place)
        told = state.command
        command = Command(
            jnp.where(changed, trim.buoyancy_mass, told.buoyancy_mass),
            place + self.pitch_gain * error.pitch,
            -sign * saturate(asked, self.largest_angle),
        )
        ran = SeaExplorerState(
            state.elapsed, phase, error.heading, integral, place, command
        )
        following: SeaExplorerState = replaced(due, ran, state)
        elapsed = jnp.where(due, 0.0, state.elapsed) + dt
        following = eqx.tree_at(
            lambda s: (s.elapsed, s.phase), following, (elapsed, phase)
        )
        return following.command, following, ControlRecord(error, error)
