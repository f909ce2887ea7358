"""The bottom of the sea: a plane, level or sloping."""

import equinox as eqx

from jaxglider.core.containers import Container, Scalar, as_float, check_interval
from jaxglider.signals import GliderState


class Seabed(Container):
    """Bottom at the depth Z_b = Z_0 + s_N X + s_E Y.

    The glider is a point in it: it has met the bottom once it is as deep.

    Attributes:
        depth: Z_0, depth of the bottom where positions count from [m].
        slope_north: s_N, growth of the depth towards north [m/m].
        slope_east: s_E, growth of the depth towards east [m/m].

    Raises:
        ValueError: the depth is not positive.
    """

    depth: Scalar = eqx.field(converter=as_float)
    slope_north: Scalar = eqx.field(converter=as_float, default=0.0)
    slope_east: Scalar = eqx.field(converter=as_float, default=0.0)

    def __check_init__(self) -> None:
        check_interval("Seabed", "depth", self.depth, 0.0)

    def altitude(self, state: GliderState) -> Scalar:
        """Height of the glider over the bottom [m], negative once it is in it."""
        bottom = (
            self.depth + self.slope_north * state.north + self.slope_east * state.east
        )
        return bottom - state.depth
