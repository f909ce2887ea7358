"""The autopilot of a glider that knows no more than its sensors show.

It stands before `Autopilot`: of raw samples it makes the state that the law is told,
with the estimator and the reckoning of the closed loop. With sound samples it does what
the closed loop does, command by command; there sensors are read at the end of a tick,
here at the start of the next one, which is the same moment.

Samples need not be sound:

- One that is not valid, no finite number, out of range, or has no finite time is
  refused; the bit `sample_refused` says so. The estimator goes on without it, as it
  does between samples.
- One that is believable in size and wrong all the same is the estimator's affair: it
  believes no jump that does not last.
- Where one of depth, roll, pitch and heading has given no good sample for `patience`,
  and before each has given its first, the autopilot is told nothing: it holds what it
  has, and after its own patience takes the safe command. Then the estimator begins
  again from what the sensors show.
- An estimator or a reckoning that is not sound begins again, or stays as it was.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Counter, Flag, Scalar
from jaxglider.navigation.estimator import AbstractEstimator, Moves
from jaxglider.navigation.reckoning import Reckoning
from jaxglider.navigation.sensing.altimeter import Altimeter, AltimeterState
from jaxglider.navigation.sensing.positioning import Fix
from jaxglider.navigation.sensing.readings import Reading, Readings, Sensed
from jaxglider.onboard.autopilot import Autopilot
from jaxglider.onboard.guard import BITS, SOUND, all_of, is_within, select, sound
from jaxglider.onboard.samples import (
    FixSample,
    Sample,
    Samples,
    age_of,
    is_fresh,
    is_new,
    measured_or,
    newest,
    with_no_traces,
)
from jaxglider.onboard.sensed_state import Heard, SensedState
from jaxglider.signals import Command, GliderState, map_fields, zeros

_NO_TIME = -1.0
"""Time of the sample before the first one [s]; no clock reads it."""


class SensedAutopilot(eqx.Module):
    """Estimator and reckoning, and the autopilot that is told what they make.

    Attributes:
        pilot: guidance, observer and law.
        estimator: estimator of the state.
        reckoning: dead reckoning.
        altimeter: altimeter, or None.
        receiver: flag, there is a receiver of satellites.
        place: position that the reckoning begins with, north and east [m].
        patience: time that a sensor may be silent [s].
    """

    pilot: Autopilot
    estimator: AbstractEstimator
    reckoning: Reckoning
    altimeter: Altimeter | None
    place: tuple[Scalar, Scalar]
    patience: Scalar
    receiver: bool = eqx.field(static=True, default=True)

    @property
    def dt(self) -> Scalar:
        """The control tick [s]."""
        return self.pilot.dt

    @property
    def actuators(self) -> Any:
        """Limits of the actuators, and a model of where they are."""
        return self.pilot.actuators

    @property
    def origin(self) -> Any:
        """Place that positions count from."""
        return self.pilot.origin

    def untold(self) -> Samples:
        """Samples of sensors that have given none: the form of its input."""
        zero, never = jnp.zeros_like(self.dt), jnp.asarray(False)
        none = Sample(zero, zero, never)
        return Samples(
            Sensed(none, none, none, none),
            zeros(Command, zero),
            None if self.altimeter is None else none,
            FixSample(zero, zero, zero, never) if self.receiver else None,
        )

    def init(self) -> SensedState:
        """Everything before the first tick."""
        zero = jnp.zeros_like(self.dt)
        still = self._standing(zeros(Sensed, zero))
        no_time = zero + _NO_TIME
        echoes = None if self.altimeter is None else self.altimeter.init(still)
        return SensedState(
            pilot=self.pilot.init(),
            earlier=zeros(Command, zero),
            begun=jnp.asarray(False),
            heard=jnp.asarray(False),
            stamps=Sensed(*(no_time,) * 4),
            shown=zeros(Sensed, zero),
            silent=Sensed(*(zero + SOUND,) * 4),
            estimator=self.estimator.init(still),
            reckoning=self.reckoning.init(still),
            echoes=echoes,
            echo_stamp=no_time,
            fix_stamp=no_time,
        )

    def plan(self, state: SensedState, time: Scalar) -> Any:
        """The reference's plan for a tick at a reading of the clock [s]."""
        return self.pilot.plan(state.pilot, time)

    def step(
        self, state: SensedState, time: Scalar, samples: Samples, planned: Any
    ) -> tuple[SensedState, Command[Scalar], Counter]:
        """One control tick; see `Autopilot.step`.

        Args:
            state: state from `init` or from the previous tick.
            time: reading of the clock [s], from zero at the start of the mission.
            samples: newest samples of the sensors.
            planned: row of `plan`, or numbers of one's own.

        Returns:
            The next state, the command for the actuators and the status word.
        """
        held = map_fields(
            measured_or, samples.position, state.pilot.held, self.pilot.limits()
        )
        known, altitude, refused = self._known(state, time, samples, held)
        estimate = self._told(known)
        after, command, word = self.pilot.step(
            eqx.tree_at(lambda at: at.held, state.pilot, held),
            time,
            estimate,
            planned,
            altitude=altitude,
            current=known.reckoning.current,
        )
        known = eqx.tree_at(lambda at: (at.pilot, at.earlier), known, (after, held))
        return known, command, word | jnp.where(refused, BITS["sample_refused"], 0)

    def _told(self, known: SensedState) -> GliderState:
        """The state that the autopilot is told: no number where nothing is known."""
        north, east = known.reckoning.place
        estimate = self.estimator.estimate(known.estimator)
        estimate = eqx.tree_at(lambda at: (at.north, at.east), estimate, (north, east))
        return jax.tree.map(lambda x: jnp.where(known.heard, x, jnp.nan), estimate)

    def _known(
        self,
        state: SensedState,
        time: Scalar,
        samples: Samples,
        held: Command[Scalar],
    ) -> tuple[SensedState, Scalar | None, Flag]:
        """Knowledge now, the altitude in it, and whether a sample was refused."""
        heard = self._heard(state, time, samples)
        stepped = self.estimator.step(
            state.estimator,
            heard.readings,
            Moves(state.earlier, held),
            zeros(GliderState, self.dt),
            self.dt,
        )
        begins = (heard.all & ~state.heard) | (state.begun & ~sound(stepped))
        anew = self.estimator.init(self._standing(heard.shown))
        estimator = select(begins, anew, select(state.begun, stepped, state.estimator))
        fix, fix_stamp, bad_fix = self._fixed(state, samples)
        estimate = self.estimator.estimate(estimator)
        reckoning = self._reckoned(state, estimate, heard.shown.depth, fix)
        altitude, echoes, echo_stamp = self._echoed(state, samples)
        known = SensedState(
            pilot=state.pilot,
            earlier=held,
            begun=state.begun | heard.all,
            heard=heard.all,
            stamps=heard.stamps,
            shown=heard.shown,
            silent=heard.silent,
            estimator=estimator,
            reckoning=reckoning,
            echoes=echoes,
            echo_stamp=echo_stamp,
            fix_stamp=fix_stamp,
        )
        return known, altitude, heard.refused | bad_fix

    def _heard(self, state: SensedState, time: Scalar, samples: Samples) -> Heard:
        """Readings of depth and attitude, and since when there were none."""
        angle, position = self.pilot.guard.angle, self.pilot.guard.position
        ranges = Sensed(position, angle, angle, angle)
        fresh = map_fields(is_fresh, samples.sensed, state.stamps, ranges)
        shown = map_fields(
            lambda new, s, old: jnp.where(new, with_no_traces(s.value), old),
            *(fresh, samples.sensed, state.shown),
        )
        silent = map_fields(
            lambda new, old: jnp.where(new, 0.0, jnp.minimum(old + self.dt, SOUND)),
            *(fresh, state.silent),
        )
        readings = map_fields(
            lambda value, new, s: Reading(value, new, age_of(s, time)),
            *(shown, fresh, samples.sensed),
        )
        refused = map_fields(
            lambda s, old, new: (is_new(s.time, old) | ~jnp.isfinite(s.time)) & ~new,
            *(samples.sensed, state.stamps, fresh),
        )
        return Heard(
            readings=Readings(readings),
            stamps=map_fields(newest, samples.sensed, state.stamps),
            shown=shown,
            silent=silent,
            all=all_of([is_within(t, self.patience) for t in silent.fields()]),
            refused=~all_of([~bad for bad in refused.fields()]),
        )

    def _standing(self, shown: Sensed[Scalar]) -> GliderState:
        """A glider at rest, where the mission begins."""
        north, east = self.place
        depth, roll, pitch, heading = shown.fields()
        return GliderState.at_rest(
            north=north, east=east, depth=depth, roll=roll, pitch=pitch, heading=heading
        )

    def _reckoned(
        self, state: SensedState, estimate: GliderState, shown: Scalar, fix: Any
    ) -> Any:
        """The belief of place; before the first tick only a fix can move it."""
        stepped = self.reckoning.step(state.reckoning, estimate, shown, fix, self.dt)
        going = state.begun & sound(stepped)
        kept = state.reckoning
        if fix is not None:
            here = jax.tree.map(
                lambda new, old: jnp.where(fix.fresh & ~state.begun, new, old),
                *((fix.north, fix.east), kept.place),
            )
            kept = eqx.tree_at(lambda at: at.place, kept, here)
        return select(going, stepped, kept)

    def _fixed(
        self, state: SensedState, samples: Samples
    ) -> tuple[Fix | None, Scalar, Flag]:
        """The fix of this tick, the time of the newest, and whether one was refused."""
        fix = samples.fix
        if fix is None:
            return None, state.fix_stamp, jnp.asarray(False)
        north = Sample(fix.north, fix.time, fix.valid)
        east = Sample(fix.east, fix.time, fix.valid)
        limit = self.pilot.guard.position
        flags = [is_fresh(s, state.fix_stamp, limit) for s in (north, east)]
        fresh, (x, y) = flags[0] & flags[1], state.reckoning.place
        taken = Fix(
            fresh, jnp.where(fresh, fix.north, x), jnp.where(fresh, fix.east, y)
        )
        # Most of the time a receiver has none: that is nothing to complain of.
        bad = fix.valid & is_new(fix.time, state.fix_stamp) & ~fresh
        return taken, newest(north, state.fix_stamp), bad

    def _echoed(
        self, state: SensedState, samples: Samples
    ) -> tuple[Scalar | None, AltimeterState | None, Scalar]:
        """The altitude, the echoes, and the newest one's time."""
        echo = samples.echo
        if echo is None or self.altimeter is None or state.echoes is None:
            return None, state.echoes, state.echo_stamp
        good = is_fresh(echo, state.echo_stamp, self.pilot.guard.position)
        good = good & self.altimeter.in_range(echo.value)
        tried = is_new(echo.time, state.echo_stamp)
        altitude, echoes = self.altimeter.heard(
            state.echoes, jnp.where(good, echo.value, 0.0), good, tried
        )
        return altitude, echoes, newest(echo, state.echo_stamp)
