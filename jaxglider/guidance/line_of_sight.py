"""Integral line-of-sight guidance: the heading that leads back to a leg."""

import equinox as eqx

from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.numerics import arctan
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE


class LineOfSight(Container):
    """Gains of the integral line-of-sight law.

    Attributes:
        lookahead: Λ [m].
        integral_gain: k_I.

    Raises:
        ValueError: the lookahead is not positive or the integral gain negative.
    """

    lookahead: Scalar = eqx.field(
        converter=as_float, metadata={"unit": "m", "set": POSITIVE}
    )
    integral_gain: Scalar = eqx.field(
        converter=as_float, metadata={"set": NOT_NEGATIVE}
    )

    def __call__(
        self, cross_track: Scalar, cross_track_rate: Scalar, integral: Scalar
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Heading relative to the leg [rad], its rate [rad/s], and σ' .

        Args:
            cross_track: y_e [m], positive to starboard of the leg.
            cross_track_rate: y_e' [m/s].
            integral: σ.
        """
        length = self.lookahead
        aim = cross_track + self.integral_gain * integral
        reach = length * length + aim * aim
        integral_rate = length * cross_track / reach
        aim_rate = cross_track_rate + self.integral_gain * integral_rate
        return -arctan(aim / length), -length * aim_rate / reach, integral_rate
