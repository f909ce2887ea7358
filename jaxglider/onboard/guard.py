"""Checks of an autopilot's inputs, and the status word that reports them.

See `autopilot` for what is done about inputs that are not sound.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import (
    Container,
    Counter,
    Flag,
    Scalar,
    as_float,
    check_interval,
)
from jaxglider.signals import Command, GliderState

STATUS = {
    "measurement_held": "a number was missing or out of range: the last good one used",
    "measurement_lost": "for longer than `patience`, or never yet: safe command",
    "clock_invalid": "the clock's reading is not finite or negative",
    "clock_stuck": "the clock's reading is the previous one",
    "clock_backwards": "the clock ran back",
    "clock_disbelieved": "the clock runs, but too far from mission time",
    "ticks_missed": "more than 1.5 Δt since the previous tick",
    "reference_held": "a number of the reference was not sound: the last good one used",
    "command_held": "the law gave no finite command: the last one held",
    "state_reset": "controller or observer started afresh",
    "saturated": "the law asked for more than an actuator has",
    "finished": "the last waypoint is reached: the last command held",
    "sample_refused": "a sensor's sample was not valid, no number, or out of range",
}
"""Bits of the status word, from the lowest on, and what they say."""

BITS = {name: 1 << n for n, name in enumerate(STATUS)}
"""Value of each bit of the status word."""

SOUND = 1e9
"""Numbers of a state or a reference beyond this modulus are not believed."""

MANY = 1_000_000_000
"""Counters stop here."""


class Guard(Container):
    """Limits of believable readings of sensors and clock.

    Attributes:
        position: largest modulus of north and east from the origin, and of depth [m].
        angle: largest roll, pitch and heading [rad].
        speed: largest surge, sway and heave [m/s].
        turn_rate: largest body rates [rad/s].
        gap: longest believable time from one tick to the next [s].
        trust: time that a clock which was set must run steadily [s].
        patience: time that old measurements stand in for missing ones [s].
        safe: command taken then, and before the first measurement.

    Raises:
        ValueError: a number is not positive.
    """

    position: Scalar = eqx.field(converter=as_float, default=1e6)
    angle: Scalar = eqx.field(converter=as_float, default=1e3)
    speed: Scalar = eqx.field(converter=as_float, default=20.0)
    turn_rate: Scalar = eqx.field(converter=as_float, default=20.0)
    gap: Scalar = eqx.field(converter=as_float, default=2.0)
    trust: Scalar = eqx.field(converter=as_float, default=1.0)
    patience: Scalar = eqx.field(converter=as_float, default=10.0)
    safe: Command[Scalar] = eqx.field(default_factory=lambda: Command(0.0, 0.0, 0.0))

    def __check_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.name != "safe":
                value = getattr(self, field.name)
                check_interval("Guard", field.name, value, low=0.0)

    def for_ticks(self, dt: Scalar) -> "Guard":
        """The same guard, its times long enough for ticks of that length [s].

        A clock read once in four seconds cannot be asked to step by two at most.
        """
        return dataclasses.replace(
            self,
            gap=jnp.maximum(self.gap, 1.5 * dt),
            trust=jnp.maximum(self.trust, 2.0 * dt),
            patience=jnp.maximum(self.patience, 3.0 * dt),
        )

    def ranges(self) -> GliderState:
        """The largest believable modulus of each state."""
        length, angle = (self.position,) * 3, (self.angle,) * 3
        return GliderState(
            *length, *angle, *((self.speed,) * 3), *((self.turn_rate,) * 3)
        )


class TimeState(eqx.Module):
    """Mission time and the clock it follows.

    Attributes:
        now: mission time of the last tick [s].
        stamp: last finite reading of the clock [s].
        offset: mission time less the clock's reading, while it is believed [s].
        steady: readings in a row that were believable steps from the one before.
    """

    now: Scalar
    stamp: Scalar
    offset: Scalar
    steady: Counter


def mission_time(
    guard: Guard, dt: Scalar, old: TimeState, running: Flag, reading: Scalar
) -> tuple[TimeState, dict[str, Flag]]:
    """Mission time, and what is to be said of the clock.

    Args:
        guard: limits of believable inputs.
        dt: control tick [s].
        old: reckoning of the previous tick.
        running: a measurement has been seen.
        reading: reading of the clock [s].
    """
    gap = guard.gap
    finite = (reading >= 0.0) & (reading <= SOUND)
    reading = jnp.where(finite, reading, old.stamp)
    elapsed = reading - old.stamp
    stepped = finite & (elapsed > 0.0) & (elapsed <= gap)
    steady = jnp.where(stepped, jnp.minimum(old.steady + 1, MANY), 0)
    trusted = steady * dt >= guard.trust
    onward = old.now + dt
    ahead = reading + old.offset - old.now
    set_back = trusted & (ahead <= 0.0)
    near = (ahead > 0.0) & ((ahead <= gap) | trusted)
    believed = finite & (~running | near | set_back)
    offset = jnp.where(running & set_back, onward - reading, old.offset)
    now = jnp.where(believed, reading + offset, onward)
    ticking = finite & running
    return TimeState(now=now, stamp=reading, offset=offset, steady=steady), {
        "clock_invalid": ~finite,
        "clock_stuck": ticking & (elapsed == 0.0),
        "clock_backwards": ticking & (elapsed < 0.0),
        "clock_disbelieved": ticking & (elapsed > 0.0) & ~believed,
        "ticks_missed": believed & running & (ahead > 1.5 * dt),
    }


def is_within(x: Scalar, limit: Scalar) -> Flag:
    """|x| ≤ limit; false for NaN.

    Args:
        x: number.
        limit: largest modulus believed.
    """
    return jnp.abs(x) <= limit


def within(x: Scalar, old: Scalar, limit: Scalar) -> Scalar:
    """The number, or the old one where it is out of its range.

    Args:
        x: number.
        old: last believed number.
        limit: largest modulus believed.
    """
    return jnp.where(is_within(x, limit), x, old)


def all_of(flags: Any) -> Flag:
    """Whether all flags of a pytree are set."""
    result = jnp.asarray(True)
    for flag in jax.tree.leaves(flags):
        result = result & flag
    return result


def sound(tree: Any) -> Flag:
    """All numbers of a state are finite and of believable size."""
    return all_of(
        [
            jnp.all(jnp.abs(x) <= jnp.asarray(SOUND, x.dtype))
            for x in jax.tree.leaves(tree)
            if jnp.issubdtype(x.dtype, jnp.floating)
        ]
    )


def select(flag: Flag, yes: Any, no: Any) -> Any:
    """One of two pytrees, leaf by leaf.

    Args:
        flag: condition.
        yes: pytree where it holds.
        no: pytree where it does not.
    """
    return jax.tree.map(lambda a, b: jnp.where(flag, a, b), yes, no)


def believed_plan(plan: Any, old: Any) -> tuple[Any, Flag]:
    """A plan, as a whole the last good one where a number is not sound.

    Args:
        plan: row of the plan.
        old: last believed one.
    """
    usable = sound(plan)
    return select(usable, plan, old), ~usable


def status_names(word: int) -> list[str]:
    """Names of the bits that are set in a status word."""
    return [name for name, bit in BITS.items() if word & bit]
