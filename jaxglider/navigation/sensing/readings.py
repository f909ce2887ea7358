"""Readings from tick to tick, and all the sensors together."""

from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider.core.containers import Container, Flag, Scalar, Series, as_float
from jaxglider.navigation.sensing.altimeter import Altimeter
from jaxglider.navigation.sensing.instrument import Instrument, Samples
from jaxglider.navigation.sensing.positioning import Fix, Positioning
from jaxglider.signals import GliderState, map_fields

T = TypeVar("T")


class Sensed(Container, Generic[T]):
    """One thing for each quantity that every glider measures under water.

    Attributes:
        depth: thing for the depth [m].
        roll: thing for the roll [rad].
        pitch: thing for the pitch [rad].
        heading: thing for the heading [rad].
    """

    depth: T = eqx.field(converter=as_float)
    roll: T = eqx.field(converter=as_float)
    pitch: T = eqx.field(converter=as_float)
    heading: T = eqx.field(converter=as_float)

    @classmethod
    def of(cls, state: GliderState) -> "Sensed[Scalar]":
        """The four of a state."""
        return Sensed(state.depth, state.roll, state.pitch, state.heading)

    def fields(self) -> tuple[T, T, T, T]:
        """The four in order."""
        return self.depth, self.roll, self.pitch, self.heading


class Reading(eqx.Module):
    """Reading of one sensor.

    Attributes:
        value: number that it shows, held since it came [unit of the quantity].
        fresh: flag, it came in this tick.
        age: time since it was taken [s].
    """

    value: Scalar
    fresh: Flag
    age: Scalar


class Readings(eqx.Module):
    """All that the glider can read at the end of a tick.

    Attributes:
        sensed: depth, roll, pitch and heading.
        altitude: height over the bottom [m], infinite while it is not seen; None
            without an altimeter or a bottom.
        fix: position by satellite, or None without a receiver.
    """

    sensed: Sensed[Reading]
    altitude: Scalar | None = None
    fix: Fix | None = None


class InstrumentState(eqx.Module):
    """State of the sensors between two ticks.

    Attributes:
        taken: last good sample of each.
        shown: number that each shows.
        altimeter: state of the altimeter, or None.
        positioning: state of the receiver, or None.
    """

    taken: Sensed[Scalar]
    shown: Sensed[Scalar]
    altimeter: Any = None
    positioning: Any = None


class InstrumentSamples(eqx.Module):
    """The realised samples of all sensors, tick by tick.

    Attributes:
        sensed: samples of depth, roll, pitch and heading.
        altimeter: samples of the altimeter, or None.
        fix_errors: errors of a fix, north and east [m], or None.
    """

    sensed: Sensed[Samples]
    altimeter: Any = None
    fix_errors: Any = None


class Sampled(eqx.Module):
    """All chance of the sensors of a run, or of a tick.

    Attributes:
        instruments: samples of the instruments.
        errors: errors of what they measure, by the names of states, or None.
    """

    instruments: InstrumentSamples
    errors: dict[str, Series] | None = None


class Instruments(Container):
    """The sensors of a glider.

    Attributes:
        sensed: sensors of depth, roll, pitch and heading.
        altimeter: altimeter, or None for none.
        positioning: receiver of satellites, or None for none.
    """

    sensed: Sensed[Instrument]
    altimeter: Altimeter | None = None
    positioning: Positioning | None = None

    def realise(self, key: jax.Array, times: Series) -> InstrumentSamples:
        """All samples of a run; every sensor has its own key.

        Args:
            key: random key of the run.
            times: times of the ticks, from zero on [s].
        """
        keys = jr.split(jr.fold_in(key, 1_000_000), 6)
        sensors = self.sensed.fields()
        parts = [s.realise(k, times) for s, k in zip(sensors, keys, strict=False)]
        altimeter = fixes = None
        if self.altimeter is not None:
            altimeter = self.altimeter.realise(keys[4], times)
        if self.positioning is not None:
            fixes = self.positioning.realise(keys[5], times)
        return InstrumentSamples(Sensed(*parts), altimeter, fixes)

    def init(self, state: GliderState) -> InstrumentState:
        """State before the first tick: a glider on deck is known.

        Args:
            state: true state at the start.
        """
        known = Sensed.of(state)
        return InstrumentState(
            known,
            known,
            None if self.altimeter is None else self.altimeter.init(state),
            None if self.positioning is None else self.positioning.init(state),
        )

    def step(
        self,
        before: InstrumentState,
        truth: GliderState,
        height: Scalar | None,
        samples: InstrumentSamples,
        dt: Scalar,
    ) -> tuple[Readings, InstrumentState]:
        """Readings at the end of a tick, and the next state.

        Args:
            before: state of the sensors at its start.
            truth: true state at its end.
            height: true height over the bottom [m], or None without one.
            samples: row of the samples.
            dt: tick [s].
        """
        values = Sensed.of(truth)
        taken = map_fields(
            lambda sensor, x, sample, old: jnp.where(
                sample.taken, sensor.reading(x, sample), old
            ),
            self.sensed,
            values,
            samples.sensed,
            before.taken,
        )
        shown = map_fields(_shown, samples.sensed, before.shown, before.taken, taken)
        sensed = map_fields(
            lambda value, sample: Reading(value, sample.shown, sample.age),
            shown,
            samples.sensed,
        )
        altitude, altimeter = None, before.altimeter
        if self.altimeter is not None and height is not None:
            altitude, altimeter = self.altimeter.step(
                altimeter, truth, height, samples.altimeter
            )
        fix, positioning = None, before.positioning
        if self.positioning is not None:
            fix, positioning = self.positioning.step(
                positioning, truth, samples.fix_errors, dt
            )
        after = InstrumentState(taken, shown, altimeter, positioning)
        return Readings(sensed, altitude, fix), after


def _shown(sample: Samples, old: Any, earlier: Any, newest: Any) -> Any:
    """The number that is shown: the newest sample, or the one before."""
    arrived = jnp.where(sample.at_once, newest, earlier)
    return jnp.where(sample.shown, arrived, old)
