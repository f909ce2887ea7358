"""Parts of laws: fields of gains, decisions, a period, an integral.

A dead band or a hold decides: move or stay. The derivative of a decision is zero
wherever it exists, so that a search by gradient never sees the width of a band. Here a
decision keeps its value, and hands on the derivative of a smooth one in its place: a
straight-through estimate. It says which way the number should go, not how far;
`jaxglider check-gradients` says how much it is worth.

Source: Bengio, Leonard and Courville, arXiv:1308.3432 (straight-through); Astrom and
Hagglund, Advanced PID Control (2006), 3.5 (back-calculation).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar, as_float
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import NOT_NEGATIVE, Interval
from jaxglider.signals import Reference

ANY = Interval(-1e3, 1e3)
"""Set of a gain that may have either sign."""
SIGN = Interval(-1.0, 1.0, closed_low=True, closed_high=True)
"""Set of the sign of a turn."""
BEFORE = 1e6
"""Clock [s] of a phase before the first: any other is a change."""
SOFTNESS = 0.2
"""Width of the smooth stand-in for a decision, as a share of the threshold."""


def gain(
    default: float, unit: str, kind: Any = NOT_NEGATIVE, tuned: bool = True
) -> Any:
    """A field of a law that holds one number.

    Args:
        default: number where nothing else is said.
        unit: unit as it stands in a key, `1_rad`; empty for a plain number.
        kind: set that the number must be in.
        tuned: flag, a search may change it.
    """
    metadata: dict[str, Any] = {"set": kind}
    if unit:
        metadata["unit"] = unit
    if not tuned:
        metadata["tuned"] = False
    return eqx.field(converter=as_float, default=default, metadata=metadata)


@jax.custom_jvp
def straight_through(value: Scalar, stand_in: Scalar) -> Scalar:
    """The value, to the last bit, with the derivative of its stand-in.

    Args:
        value: number as it is.
        stand_in: number whose derivative is taken.
    """
    return value


@straight_through.defjvp
def _stand_in_jvp(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    return primals[0], tangents[1]


def beyond(modulus: Scalar, threshold: Scalar) -> Scalar:
    """1 above a threshold and 0 up to it; the slope is that of a logistic function.

    Args:
        modulus: number that decides, not negative.
        threshold: number it is compared with; a negative one is always passed.
    """
    width = SOFTNESS * jnp.maximum(jnp.abs(threshold), 1e-6)
    soft = jax.nn.sigmoid((modulus - threshold) / width)
    return straight_through((modulus > threshold).astype(soft.dtype), soft)


def either(first: Scalar, second: Scalar) -> Scalar:
    """1 where one of two decisions is 1, else 0.

    Args:
        first: decision, 0 or 1.
        second: decision, 0 or 1.
    """
    return first + second - first * second


def chosen(decision: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """One of two numbers by a decision, 1 or 0, that may have a derivative.

    Args:
        decision: 1 for the first number, 0 for the second.
        yes: number for 1.
        no: number for 0.
    """
    return decision * yes + (1.0 - decision) * no


def is_due(waited: Scalar, period: Scalar, dt: Scalar) -> Flag:
    """Flag, a law with a period of its own is to run in this tick.

    Half a tick is forgiven, so that roundings of the clock do not cost a whole one.

    Args:
        waited: time since it last ran, this tick not counted [s].
        period: period of the law [s]; one below a tick runs it in every tick.
        dt: tick [s].
    """
    return waited + 0.5 * dt >= period


def wound_back(
    integral: Scalar,
    added: Scalar,
    short: Scalar,
    tracking_time: Scalar,
    dt: Scalar,
) -> Scalar:
    """An integral that follows the actuator: I + Δt (rate + (u_held − u_asked)/T_t).

    Args:
        integral: I, in the unit of the actuator.
        added: rate by the error, 1/s of that.
        short: u_held − u_asked of the tick before.
        tracking_time: T_t > 0 [s].
        dt: tick [s].
    """
    return integral + dt * (added + short / tracking_time)


def sampled_rate(now: Scalar, before: Scalar, elapsed: Scalar, first: Flag) -> Scalar:
    """Rate of an angle by the difference of two samples, the short way round [rad/s].

    Zero at the first sample, which has no other.

    Args:
        now: sample [rad].
        before: sample of the run before [rad].
        elapsed: time between them [s].
        first: flag, there was none before.
    """
    return jnp.where(first, 0.0, wrap(now - before) / elapsed)


def replaced(due: Flag, fresh: Any, kept: Any) -> Any:
    """Memory of a law with a period of its own after a tick: new if it was due.

    Args:
        due: flag, the law runs in this tick.
        fresh: result of a run, a pytree.
        kept: result of the run before.
    """
    return jax.tree.map(lambda new, old: jnp.where(due, new, old), fresh, kept)


class Phase(NamedTuple):
    """The phase that a law last saw.

    Attributes:
        number: number of the phase of a yo; 0 where there is none.
        clock: time since the last inflection, or change of what is asked [s].
    """

    number: Scalar
    clock: Scalar


def phase_of(reference: Reference) -> Phase:
    """The phase that is on.

    Args:
        reference: wanted outputs, with orders where a plan gives them.
    """
    # A strong type, as a memory has to be.
    clock = reference.clock.astype(reference.clock.dtype)
    if reference.orders is None:
        return Phase(jnp.zeros_like(clock), clock)
    return Phase(reference.orders.phase.astype(clock.dtype), clock)


def has_changed(before: Phase, now: Phase) -> Flag:
    """Flag, another phase or segment has begun.

    Args:
        before: phase of the tick before.
        now: phase of this one.
    """
    return (now.number != before.number) | (now.clock < before.clock)
