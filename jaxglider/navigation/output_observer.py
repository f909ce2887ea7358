"""Observers of the outputs: value, rate and what drives it, for each that is read.

Each of depth, roll, pitch and heading is a double integrator, y'' = f + d, with f known
and d not. Between readings ŷ, ŷ' and d̂ go on by themselves; a fresh one corrects them,
by a rule of the subclass. The body velocity follows: the angular one from the rates of
the attitude, the linear one from the depth rate of a steady glide (`glide`).
"""

from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Scalar, as_float
from jaxglider.core.rotations import wrap
from jaxglider.navigation.estimator import AbstractEstimator, Moves, innovation
from jaxglider.navigation.glide import angle_of_attack, horizontal_speed
from jaxglider.navigation.sensing.readings import Reading, Readings, Sensed
from jaxglider.signals import Command, GliderState, map_fields
from jaxglider.vehicle.design_model import DesignModel

_LARGEST_JUMP = 10.0, 1.0, 1.0, 1.0
"""Surprises that are not believed at once [m, rad]."""
_LARGEST_RATE, _LARGEST_PUSH = 0.7, 0.1
"""Moduli that no rate and no d̂ exceeds [m/s, rad/s, and per second]."""
_LARGEST_TURN = 1.5
"""Angle that no output is taken to go through between readings [rad]: beyond half a
turn it could as well go the other way."""


class OutputState(eqx.Module):
    """Belief about one output.

    Attributes:
        value: ŷ [m or rad].
        rate: ŷ' [m/s or rad/s].
        push: d̂ [m/s² or rad/s²].
        since: time since the last reading that was believed [s].
        missed: number of readings in a row that were not.
    """

    value: Scalar
    rate: Scalar
    push: Scalar
    since: Scalar
    missed: Scalar


class ObserverMemory(eqx.Module):
    """State of an observer of the outputs.

    Attributes:
        outputs: beliefs about depth, roll, pitch and heading.
        speed: U, horizontal speed through the water [m/s].
    """

    outputs: Sensed[OutputState]
    speed: Scalar


class Correction(NamedTuple):
    """Additions of a reading to value, rate and push."""

    value: Scalar
    rate: Scalar
    push: Scalar


class OutputObserver(AbstractEstimator):
    """An observer of the outputs; subclasses give the correction.

    Attributes:
        model: design model, for the steady glide, and for f where it is known.
        knows_model: flag, f is that of the design model; else it is zero.
    """

    model: DesignModel
    knows_model: ClassVar[bool] = False

    @abstractmethod
    def corrections(
        self, surprises: Sensed[Scalar], intervals: Sensed[Scalar]
    ) -> Sensed[Correction]:
        """Additions of readings.

        Args:
            surprises: readings less what was expected of them [m, rad].
            intervals: times since the readings before [s].
        """

    def init(self, state: GliderState) -> ObserverMemory:
        """On deck, at rest."""
        zero = jnp.zeros_like(state.depth)
        outputs = map_fields(
            lambda x: OutputState(x, zero, zero, zero, zero), Sensed.of(state)
        )
        return ObserverMemory(outputs, zero)

    def estimate(self, estimator_state: ObserverMemory) -> GliderState:
        """The state, its linear velocity that of a steady glide."""
        o, speed = estimator_state.outputs, estimator_state.speed
        still = GliderState.at_rest(
            north=jnp.zeros_like(speed),
            depth=o.depth.value,
            roll=o.roll.value,
            pitch=o.pitch.value,
            heading=o.heading.value,
        )
        a = still.attitude()
        # What the rates of roll, pitch and heading are in the body frame.
        p = o.roll.rate - a.sin_pitch * o.heading.rate
        q = a.cos_roll * o.pitch.rate + a.cos_pitch * a.sin_roll * o.heading.rate
        r = a.cos_pitch * a.cos_roll * o.heading.rate - a.sin_roll * o.pitch.rate
        # Straight ahead at U, and down at Z': no sideslip.
        ahead = a.cos_pitch * speed - a.sin_pitch * o.depth.rate
        below = a.sin_pitch * speed + a.cos_pitch * o.depth.rate
        return GliderState.at_rest(
            **{
                **vars(still),
                "surge": ahead,
                "sway": a.sin_roll * below,
                "heave": a.cos_roll * below,
                "roll_rate": p,
                "pitch_rate": q,
                "yaw_rate": r,
            }
        )

    def step(
        self,
        estimator_state: ObserverMemory,
        readings: Readings,
        moves: Moves,
        truth: GliderState,
        dt: Scalar,
    ) -> ObserverMemory:
        """Go on by one tick, then take what is fresh."""
        known = self._known(estimator_state, moves.end)
        ahead = map_fields(
            lambda o, f: _gone_on(o, f, dt), estimator_state.outputs, known
        )
        jumps, turns = Sensed(*_LARGEST_JUMP), Sensed(*_TURNS)
        seen = map_fields(_seen, readings.sensed, ahead, turns, jumps)
        corrections = self.corrections(
            map_fields(lambda s: s.value, seen), map_fields(lambda o: o.since, ahead)
        )
        outputs = map_fields(_corrected, ahead, seen, corrections, readings.sensed)
        outputs = Sensed(
            outputs.depth,
            _unturned(outputs.roll),
            _unturned(outputs.pitch),
            outputs.heading,
        )
        parameters = self.model.parameters
        pitch = outputs.pitch.value
        alpha = angle_of_attack(parameters, 0.0 * parameters.drag, pitch)
        speed = horizontal_speed(
            pitch, alpha, outputs.depth.rate, estimator_state.speed, dt
        )
        return ObserverMemory(outputs, speed)

    def _known(self, memory: ObserverMemory, command: Command[Scalar]) -> Any:
        """f of each output [m/s², rad/s²].

        That of the depth alone is taken from the model, weight and drag along the path:
        attitude and heave swing faster than readings come, and their f would be that of
        a moment which is long gone.
        """
        zeros = map_fields(lambda o: jnp.zeros_like(o.rate), memory.outputs)
        if not self.knows_model:
            return zeros
        parameters, pitch = self.model.parameters, memory.outputs.pitch.value
        path = pitch - angle_of_attack(parameters, 0.0 * pitch, pitch)
        speed = memory.speed / jnp.cos(path)
        weight = parameters.gravity * command.buoyancy_mass
        along = -weight * jnp.sin(path) - parameters.drag * speed * speed
        fallen = -jnp.sin(path) * along / parameters.surge_mass
        return Sensed(fallen, zeros.roll, zeros.pitch, zeros.heading)


_TURNS = 0.0, 1.0, 1.0, 1.0
"""One for each output that is an angle."""


def _gone_on(o: OutputState, known: Scalar, dt: Scalar) -> OutputState:
    """An output one tick later, exactly for f and d̂ that stay as they are."""
    pushed = known + o.push
    return OutputState(
        value=o.value + dt * o.rate + 0.5 * dt * dt * pushed,
        rate=o.rate + dt * pushed,
        push=o.push,
        since=o.since + dt,
        missed=o.missed,
    )


def _unturned(o: OutputState) -> OutputState:
    """An angle without full turns."""
    return eqx.tree_at(lambda at: at.value, o, wrap(o.value))


def _seen(reading: Reading, o: OutputState, turns: Scalar, limit: Scalar) -> Any:
    surprise = reading.value - (o.value - reading.age * o.rate)
    surprise = jnp.where(turns > 0.0, wrap(surprise), surprise)
    return innovation(reading, surprise, limit, o.missed)


def _corrected(
    o: OutputState, seen: Any, correction: Correction, reading: Reading
) -> OutputState:
    def pick(believed: Scalar, begun: Scalar, other: Scalar) -> Scalar:
        taken = jnp.where(seen.lost, begun, believed)
        return jnp.where(seen.believed, taken, other)

    def within(x: Scalar, limit: Scalar | float) -> Scalar:
        return jnp.clip(x, -limit, limit)

    value = o.value + seen.value
    zero = jnp.zeros_like(value)
    fastest = jnp.minimum(_LARGEST_RATE, _LARGEST_TURN / o.since)
    return OutputState(
        value=pick(o.value + correction.value, value, o.value),
        rate=within(pick(o.rate + correction.rate, zero, o.rate), fastest),
        push=within(pick(o.push + correction.push, zero, o.push), _LARGEST_PUSH),
        since=jnp.where(seen.believed, as_float(0.0 * o.since), o.since),
        missed=seen.missed,
    )
