"""An altimeter: a narrow beam, a range, and three good echoes in a row.

The beam leans back from the body's own vertical by the pitch of a dive, so that it
points straight down in one. It sees the bottom while it points within a cone about
straight down, at heights within its range, with the glider deep enough. What is
believed is the median of the last three echoes, once three in a row were good.

Source: the rules that operators of Slocum gliders set.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar, as_float
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE
from jaxglider.navigation.sensing.instrument import Instrument, Samples
from jaxglider.signals import GliderState

_IN_A_ROW = 3


def _distance(default: float, kind: Any = POSITIVE) -> Any:
    return eqx.field(converter=as_float, default=default, metadata={"set": kind})


class AltimeterState(eqx.Module):
    """The last echoes.

    Attributes:
        newest: last good echo [m].
        before: echo before it [m].
        third: echo before that [m].
        count: number of good ones in a row, up to three.
    """

    newest: Scalar
    before: Scalar
    third: Scalar
    count: Scalar


class Altimeter(Instrument):
    """The altimeter of a glider.

    Attributes:
        nearest: least height that it measures [m].
        farthest: largest height that it measures [m].
        cone: angle from straight down within which it sees the bottom [rad].
        lean: pitch at which the beam points straight down [rad], negative in a dive.
        least_depth: depth above which it is switched off [m].

    Raises:
        ValueError: a number is out of its range.
    """

    nearest: Scalar = _distance(2.0, NOT_NEGATIVE)
    farthest: Scalar = _distance(100.0)
    cone: Scalar = _distance(0.1745)
    lean: Scalar = eqx.field(converter=as_float, default=-0.4538)
    least_depth: Scalar = _distance(2.0, NOT_NEGATIVE)

    def init(self, state: GliderState) -> AltimeterState:
        """No echo yet."""
        zero = jnp.zeros_like(state.depth)
        return AltimeterState(zero, zero, zero, zero)

    def step(
        self,
        before: AltimeterState,
        truth: GliderState,
        height: Scalar,
        sample: Samples,
    ) -> tuple[Scalar, AltimeterState]:
        """The height that is believed [m], infinite for none, and the next state.

        Args:
            before: echoes so far.
            truth: true state.
            height: true height over the bottom [m].
            sample: row of the samples.
        """
        good = sample.taken & self.sees(truth, height)
        return self.heard(before, self.reading(height, sample), good, sample.taken)

    def sees(self, truth: GliderState, height: Scalar) -> Flag:
        """Whether the bottom would give an echo.

        Args:
            truth: true state.
            height: true height over the bottom [m].
        """
        off = jnp.hypot(truth.pitch - self.lean, truth.roll)
        deep = truth.depth >= self.least_depth
        return (off <= self.cone) & deep & self.in_range(height)

    def in_range(self, height: Scalar) -> Flag:
        """Whether a height is one that it measures."""
        return (height >= self.nearest) & (height <= self.farthest)

    def heard(
        self, before: AltimeterState, echo: Scalar, good: Flag, tried: Flag
    ) -> tuple[Scalar, AltimeterState]:
        """The height that is believed [m], infinite for none, and the next state.

        Args:
            before: echoes so far.
            echo: height that the newest echo tells [m].
            good: flag, there is a new echo, and it is good.
            tried: flag, it has listened for one.
        """
        count = jnp.where(good, jnp.minimum(before.count + 1.0, _IN_A_ROW), 0.0)
        after = AltimeterState(
            newest=jnp.where(good, echo, before.newest),
            before=jnp.where(good, before.newest, before.before),
            third=jnp.where(good, before.before, before.third),
            count=jnp.where(tried, count, before.count),
        )
        least = jnp.minimum(after.newest, after.before)
        most = jnp.maximum(after.newest, after.before)
        median = jnp.clip(after.third, least, most)
        return jnp.where(after.count >= _IN_A_ROW, median, jnp.inf), after
