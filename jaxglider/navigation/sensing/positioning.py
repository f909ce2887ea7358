"""Positions by satellite: at the surface alone, and not at once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider.core.containers import Container, Flag, Scalar, Series, as_float
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE
from jaxglider.signals import GliderState


class Fix(eqx.Module):
    """A position by satellite.

    Attributes:
        fresh: flag, it came in this tick.
        north: position north [m].
        east: position east [m].
    """

    fresh: Flag
    north: Scalar
    east: Scalar


class PositioningState(eqx.Module):
    """State of the receiver.

    Attributes:
        listening: time with the antenna out of the water [s].
        waited: time since the last fix [s].
    """

    listening: Scalar
    waited: Scalar


class Positioning(Container):
    """A receiver of satellites.

    Attributes:
        first_fix: time from surfacing to the first fix [s].
        period: time from one fix to the next [s].
        noise: standard deviation of a fix, north and east each [m].
        depth: depth above which the antenna is out of the water [m].

    Raises:
        ValueError: a number is out of its range.
    """

    first_fix: Scalar = eqx.field(
        converter=as_float, default=60.0, metadata={"set": NOT_NEGATIVE}
    )
    period: Scalar = eqx.field(
        converter=as_float, default=10.0, metadata={"set": POSITIVE}
    )
    noise: Scalar = eqx.field(
        converter=as_float, default=2.8, metadata={"set": NOT_NEGATIVE}
    )
    depth: Scalar = eqx.field(
        converter=as_float, default=0.5, metadata={"set": POSITIVE}
    )

    def realise(self, key: jax.Array, times: Series) -> tuple[Series, Series]:
        """Errors of a fix at each tick, north and east [m].

        Args:
            key: random key of the receiver in this run.
            times: times of the ticks [s].
        """
        north, east = self.noise * jr.normal(key, (2, *times.shape), times.dtype)
        return north, east

    def init(self, state: GliderState) -> PositioningState:
        """Just switched on."""
        zero = jnp.zeros_like(state.depth)
        return PositioningState(zero, zero)

    def step(
        self,
        before: PositioningState,
        truth: GliderState,
        errors: tuple[Scalar, Scalar],
        dt: Scalar,
    ) -> tuple[Fix, PositioningState]:
        """The fix of this tick, if there is one, and the next state.

        Args:
            before: state of the receiver.
            truth: true state.
            errors: errors of a fix, north and east [m].
            dt: tick [s].
        """
        out = truth.depth < self.depth
        listening = jnp.where(out, before.listening + dt, 0.0)
        waited = before.waited + dt
        ready = out & (listening >= self.first_fix)
        # The first one of a stay waits for nothing else.
        first = before.listening < self.first_fix
        fresh = ready & (first | (waited >= self.period))
        fix = Fix(fresh, truth.north + errors[0], truth.east + errors[1])
        return fix, PositioningState(listening, jnp.where(fresh, 0.0, waited))
