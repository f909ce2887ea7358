"""What tuning makes small: the three tracking errors, each against where it started."""

import equinox as eqx
import jax.numpy as jnp

from jaxglider._types import Scalar, Series
from jaxglider.metrics import Metrics
from jaxglider.rollout import ClosedLoop, evaluate
from jaxglider.signals import BodyAxes, Channels, each


class RelativeTracking(eqx.Module):
    """Σ over the channels of L2[e] over its starting value: 3 at the start.

    Attributes:
        start: L2[e] of each channel with the starting gains [m, rad].
    """

    start: Channels[Scalar]

    @classmethod
    def of(cls, metrics: Metrics) -> "RelativeTracking":
        """The objective that is 3 for these metrics."""
        return cls(each(lambda channel: channel.rms_error, metrics.channels))

    def __call__(self, loop: ClosedLoop, sea: BodyAxes[Series]) -> Scalar:
        """The objective of one rollout."""
        channels = evaluate(loop, sea).channels
        ratios = each(lambda c, start: c.rms_error / start, channels, self.start)
        return jnp.asarray(ratios.depth + ratios.pitch + ratios.heading)
