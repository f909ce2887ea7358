"""The law that Seagliders fly: a map for the pitch, turns by roll from stop to stop.

It runs once in a guidance interval, and at once where another phase begins. The mass
goes to the place of a map, with a shift that is learnt,

r_p = c − θ_d/g + s m_b + a,     Δa = k e_θ where |e_θ| is outside its band,

the latter from the third look of a phase on, and stays for moves below a smallest one.
Where the heading is outside its band the mass rolls to ±γ_max, to the other side in a
climb; each tick looks whether the error has passed zero or the turn has lasted its
longest time, and then the mass goes back to its centre, which itself is trimmed by the
turn rate seen while nobody turns: Δγ₀ = −k₀ ψ' outside a band.

Where no plan orders the ballast it comes from the design model, and where the depth
rate is too low by more than a band it is increased by k_w times what is missing. With
a plan both that and the apogee in two steps are the plan's (`guidance.phases`).

Source: the vendor's parameter list and the log of number 167: 40 deg/cm and 0.0015 cm
for each cm³ give −0.656 cm for −16.6 deg and −160.6 cm³, forward counted negative and
cm³ as displaced there. Assumed: a starts at zero in each phase; k₀ and its band from
the list's middle; the time between two looks does not depend on the depth.
"""

import math

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.balance import angle_of_attack, trim_position, wanted_trim
from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.flown.roll import Roll, RollGains, begun, ended
from jaxglider.control.parts import (
    BEFORE,
    SIGN,
    Phase,
    beyond,
    chosen,
    gain,
    has_changed,
    is_due,
    phase_of,
    replaced,
)
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.containers import Flag, Scalar
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

LEFT_ALONE = 2.0
"""Number of looks at the start of a phase that do not adjust the pitch."""
_SHALLOW = 0.3
_ANGLE = Interval(-0.5, 0.5)


class SeagliderState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        elapsed: time since the last look [s].
        phase: phase at the tick before; before the first its clock is `BEFORE`.
        looks: number of looks in this phase.
        adjustment: a, shift of the mass that is learnt [m].
        more: ballast added for the depth rate [kg].
        roll: memory of the turns.
        command: command of the last run [kg, m, rad].
    """

    elapsed: Scalar
    phase: Phase
    looks: Scalar
    adjustment: Scalar
    more: Scalar
    roll: Roll
    command: Command[Scalar]


class Seaglider(AbstractController):
    """A map for the pitch, turns from stop to stop, ballast by the depth rate.

    Attributes:
        model: design model, which gives the ballast where no plan does.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        pitch_map: g, pitch for a move of the mass aft [rad/m]; PITCH_GAIN.
        ballast_shift: s, move of the mass for ballast [m/kg]; PITCH_VBD_SHIFT.
        pitch_centre: c, place of the mass for a level glider [m]; C_PITCH.
        adjust_gain: k, move for an error of the pitch [m/rad]; PITCH_ADJ_GAIN. At
            g k ≥ 2 the pitch swings ever more from look to look.
        adjust_band: |e_θ| within which nothing is learnt [rad]; PITCH_ADJ_DBAND.
        least_move: smallest move of the mass [m]; PITCH_DBAND.
        roll_angle: γ_max [rad]; ROLL_DEG.
        heading_band: |e_ψ| that is left alone [rad]; HEAD_ERRBAND.
        longest_turn: longest time of a turn [s]; T_TURN.
        dive_centre: γ₀ in dives, at the start [rad]; C_ROLL_DIVE.
        climb_centre: γ₀ in climbs, at the start [rad]; C_ROLL_CLIMB.
        centre_gain: k₀ [s]; ROLL_ADJ_GAIN.
        centre_band: |ψ'| within which the centre is left alone [rad/s].
        dive_sign: sign of the turn by a positive angle in dives, 1 for starboard.
        climb_sign: sign of that in climbs.
        rate_gain: k_w, ballast per missing depth rate [kg s/m]; DBDW.
        rate_band: missing depth rate that is borne [m/s]; W_ADJ_DBAND.
        interval: time from one look to the next [s].

    Raises:
        ValueError: a number is outside its set.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    pitch_map: Scalar = gain(69.81, "rad_m", POSITIVE)
    ballast_shift: Scalar = gain(0.0146, "m_kg", Interval(-1.0, 1.0))
    pitch_centre: Scalar = gain(0.0, "m", _ANGLE)
    adjust_gain: Scalar = gain(0.002865, "m_rad")
    adjust_band: Scalar = gain(0.0131, "rad")
    least_move: Scalar = gain(5e-4, "m")
    roll_angle: Scalar = gain(0.698, "rad", Interval(0.0, math.pi / 2))
    heading_band: Scalar = gain(0.1745, "rad")
    longest_turn: Scalar = gain(225.0, "s", POSITIVE)
    dive_centre: Scalar = gain(0.0, "rad", _ANGLE)
    climb_centre: Scalar = gain(0.0, "rad", _ANGLE)
    centre_gain: Scalar = gain(1.5, "s")
    centre_band: Scalar = gain(7e-4, "rad_s")
    dive_sign: Scalar = gain(1.0, "", SIGN, tuned=False)
    climb_sign: Scalar = gain(-1.0, "", SIGN, tuned=False)
    rate_gain: Scalar = gain(2.6, "kg_s_m")
    rate_band: Scalar = gain(0.005, "m_s")
    interval: Scalar = gain(300.0, "s", POSITIVE, tuned=False)

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> "Seaglider":
        """The law as flown, its map that of the vehicle, as its pilot would find it.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, the law has its own.
        """
        zero = jnp.zeros_like(model.parameters.drag)

        def place(pitch: float, ballast: float) -> Scalar:
            theta = zero + pitch
            alpha = angle_of_attack(model, theta)
            return trim_position(model, theta, zero + ballast, alpha)

        down, up = place(-_SHALLOW, 0.1), place(_SHALLOW, -0.1)
        heavy, light = place(-_SHALLOW, 0.2), place(-_SHALLOW, 0.1)
        shift = (heavy - light) / 0.1
        return cls(
            model,
            funnel,
            pitch_map=2.0 * _SHALLOW / (down - up - 0.2 * shift),
            ballast_shift=shift,
            pitch_centre=0.5 * (down + up),
            climb_sign=1.0 if isinstance(model.actuation, FinActuation) else -1.0,
        )

    def cycle_time(self) -> Scalar:
        """Time from one run to the next [s]."""
        return self.interval

    def init(self) -> SeagliderState:
        """Nothing learnt; the first tick begins a phase."""
        zero = jnp.zeros_like(self.interval)
        return SeagliderState(
            elapsed=zero,
            phase=Phase(zero, zero + BEFORE),
            looks=zero,
            adjustment=zero,
            more=zero,
            roll=Roll(zero, zero, self.dive_centre, self.climb_centre),
            command=zeros(Command, zero),
        )

    def place(self, pitch: Scalar, ballast: Scalar) -> Scalar:
        """Place of the mass by the map alone: c − θ_d/g + s m_b [m].

        Args:
            pitch: θ_d [rad].
            ballast: m_b [kg].
        """
        return self.pitch_centre - pitch / self.pitch_map + self.ballast_shift * ballast

    def step(
        self,
        state: SeagliderState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], SeagliderState, ControlRecord]:
        """One tick: a look if it is time, and the end of a turn whenever it comes."""
        error, rate = tracking_error(measurement, reference)
        phase = phase_of(reference)
        changed = has_changed(state.phase, phase)
        due = changed | is_due(state.elapsed, self.interval, dt)
        climbing = reference.position.pitch > 0.0
        gains = self.roll_gains()
        kept = ended(state.roll, error.heading, gains, dt)
        turn_rate = rate.heading + reference.rate.heading
        sign = jnp.where(climbing, self.climb_sign, self.dive_sign)
        fresh = begun(kept, error.heading, turn_rate, climbing, sign, gains)
        roll: Roll = replaced(due, fresh, kept)
        looked = self._look(
            state, measurement, reference, error.pitch, rate.depth, changed
        )
        now: SeagliderState = replaced(due, looked, state)
        command = Command(
            now.command.buoyancy_mass,
            now.command.mass_position,
            roll.centre(climbing) - sign * self.roll_angle * roll.turn,
        )
        elapsed = jnp.where(due, 0.0, state.elapsed) + dt
        following = eqx.tree_at(
            lambda s: (s.command, s.elapsed, s.phase, s.roll),
            now,
            (command, elapsed, phase, roll),
        )
        return command, following, ControlRecord(error, error)

    def roll_gains(self) -> RollGains:
        """The numbers of the turns."""
        return RollGains(
            self.heading_band, self.longest_turn, self.centre_gain, self.centre_band
        )

    def _look(
        self,
        state: SeagliderState,
        measurement: Measurement,
        reference: Reference,
        error: Scalar,
        depth_rate: Scalar,
        changed: Flag,
    ) -> SeagliderState:
        """The memory after a look at pitch and ballast."""
        looks = jnp.where(changed, 0.0, state.looks)
        learns = jnp.where(looks >= LEFT_ALONE, 1.0, 0.0).astype(looks.dtype)
        learns *= beyond(jnp.abs(error), self.adjust_band)
        adjustment = jnp.where(changed, 0.0, state.adjustment)
        adjustment += learns * self.adjust_gain * error
        more, ballast = self._ballast(state, measurement, reference, depth_rate, looks)
        place = self.place(reference.position.pitch, ballast) + adjustment
        held = state.command.mass_position
        moves = beyond(jnp.abs(place - held), self.least_move)
        place = jnp.where(changed, place, chosen(moves, place, held))
        return SeagliderState(
            elapsed=state.elapsed,
            phase=state.phase,
            looks=looks + 1.0,
            adjustment=adjustment,
            more=more,
            roll=state.roll,
            command=Command(ballast, place, state.command.mass_angle),
        )

    def _ballast(
        self,
        state: SeagliderState,
        measurement: Measurement,
        reference: Reference,
        depth_rate: Scalar,
        looks: Scalar,
    ) -> tuple[Scalar, Scalar]:
        """Ballast added for the depth rate, and the whole ballast with it [kg]."""
        trim = wanted_trim(self.model, measurement, reference).buoyancy_mass
        if reference.orders is not None:
            return state.more, trim
        wanted = reference.rate.depth
        missing = jnp.abs(wanted) - jnp.abs(wanted + depth_rate)
        slow = beyond(missing, self.rate_band) * self.rate_gain * missing
        more = jnp.where(looks > 0.0, state.more + slow, 0.0)
        return more, trim + jnp.sign(trim) * more
