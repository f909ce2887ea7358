"""The funnel: how large an error may be, and the transformation that keeps it there."""

import equinox as eqx
import jax

from jaxglider.control.prescribed.performance import AbstractPerformanceFunction, Bound
from jaxglider.control.prescribed.transform import ErrorTransformation, TransformedError
from jaxglider.core.containers import Container, Scalar
from jaxglider.signals import Channels, map_fields


class Limits(eqx.Module):
    """The funnel's edges at one instant: −δ_L P and δ_R P, unit of the channel."""

    lower: Scalar
    upper: Scalar


class Funnel(Container):
    """Performance functions and error transformations of the three channels.

    Attributes:
        performance: P of each channel.
        transformation: T of each channel.
    """

    performance: Channels[AbstractPerformanceFunction]
    transformation: Channels[ErrorTransformation]

    @jax.named_scope("performance_functions")
    def bounds(self, clock: Scalar) -> Channels[Bound]:
        """P, P', P'' of each channel at t* [s]."""
        return map_fields(lambda p: p(clock), self.performance)

    def limits(self, bounds: Channels[Bound]) -> Channels[Limits]:
        """−δ_L P and δ_R P of each channel."""
        return map_fields(
            lambda b, t: Limits(-t.lower * b.value, t.upper * b.value),
            bounds,
            self.transformation,
        )

    @jax.named_scope("error_transformation")
    def transform(
        self,
        error: Channels[Scalar],
        rate: Channels[Scalar],
        bounds: Channels[Bound],
    ) -> Channels[TransformedError]:
        """ε, ε', κ and λ of each channel.

        Args:
            error: e of each channel [m, rad].
            rate: e' of each channel [m/s, rad/s].
            bounds: performance functions now.
        """
        return map_fields(
            lambda t, e, e1, b: t(e, e1, b), self.transformation, error, rate, bounds
        )
