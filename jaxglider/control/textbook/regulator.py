"""Common part of regulators about the trims of dive and climb: glides, weights, x − x*.

x* is the trim of the wanted glide: pitch and heading wanted, no roll, no rate, and the
velocity of a straight glide. Errors count up to a largest one each, so that a linear
law is not asked for what only a small deviation would bear.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645 (a linear model about each glide). Assumed: weights on the diagonals only, first
ones by Bryson's rule, 1 over the square of what is bearable.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control import parts
from jaxglider.control.balance import FLATTEST_PATH, angle_of_attack
from jaxglider.control.controller import AbstractController
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.steering import AbstractSteering
from jaxglider.control.textbook.linear_design import (
    ScaledStep,
    StateRow,
    scaled_step,
    trim_of,
)
from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import sincos
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.signals import Channels, Command, Measurement, Reference
from jaxglider.vehicle.design_model import DesignModel

_SLOPE = Interval(0.1, math.pi / 2)
Own = TypeVar("Own", bound="AbstractRegulator")
Design = TypeVar("Design")


def _weights() -> StateRow:
    """Q: 0.3 m, 0.3 rad, 0.1 rad, 0.3 rad, 0.1 m/s and 0.1 rad/s are bearable."""
    bearable = (0.3, 0.3, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
    return StateRow(*(1.0 / x**2 for x in bearable))


def _efforts() -> Command[Scalar]:
    """R: 0.05 kg, 1 cm and 0.3 rad are."""
    return Command(1.0 / 0.05**2, 1.0 / 0.01**2, 1.0 / 0.3**2)


def _largest() -> Channels[Scalar]:
    return Channels(1.0, 0.5, 0.4)


class AbstractRegulator(AbstractController):
    """A law designed with the linear model about a dive and about a climb.

    Attributes:
        model: design model, which the trims are taken from.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        design_pitch: |θ| of the two glides that the law is designed about [rad].
        design_rate: |Z'| of them [m/s].
        weights: diagonal of Q, 1 over the square of a bearable deviation each.
        efforts: diagonal of R, likewise [1/kg², 1/m², 1/rad²].
        largest: error that larger ones count as [m, rad].
        period: time from one run to the next [s]; not less than the tick, for the
            law is designed for it.

    Raises:
        ValueError: a number is outside its set.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    design_pitch: Scalar = parts.gain(0.8, "rad", _SLOPE, tuned=False)
    design_rate: Scalar = parts.gain(0.1, "m_s", POSITIVE, tuned=False)
    weights: StateRow = eqx.field(default_factory=_weights, metadata={"set": POSITIVE})
    efforts: Command[Scalar] = eqx.field(
        default_factory=_efforts, metadata={"set": POSITIVE}
    )
    largest: Channels[Scalar] = eqx.field(
        default_factory=_largest, metadata={"set": POSITIVE, "tuned": False}
    )
    period: Scalar = parts.gain(1.0, "s", POSITIVE, tuned=False)

    @classmethod
    def initial(
        cls: type[Own],
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> Own:
        """The law with weights by Bryson's rule, for the paper's glides.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, the law steers itself.
        """
        return cls(model, funnel)

    def integral_weights(self) -> Channels[Scalar] | None:
        """Weights of ∫e dt of each channel; None for none."""
        return None

    def paced(self: Own, tick: Scalar) -> Own:
        """The law designed to run every tick [s], where it would run more often."""
        return dataclasses.replace(self, period=jnp.maximum(self.period, tick))

    def cycle_time(self) -> Scalar:
        """Time from one run of the law to the next [s]."""
        return self.period

    def of_both(self, design: Callable[[ScaledStep], Design]) -> tuple[Design, Design]:
        """A design about the dive, and the same about the climb.

        Args:
            design: function of the linear model over one period.
        """
        pitch = jnp.stack([-self.design_pitch, self.design_pitch])

        def about(pitch: Scalar) -> Any:
            step = scaled_step(
                self.model,
                trim_of(self.model, pitch, self.design_rate),
                self.period,
                self.weights,
                self.efforts,
                self.integral_weights(),
            )
            return design(step)

        both = jax.vmap(about)(pitch)
        dive, climb = (jax.tree.map(lambda x, n=n: x[n], both) for n in (0, 1))
        return dive, climb

    def deviation(
        self,
        measurement: Measurement,
        reference: Reference,
        error: Channels[Scalar],
    ) -> StateRow:
        """x − x*, the errors of the outputs as they count.

        Args:
            measurement: everything that may be known of the glider.
            reference: wanted outputs with their rates.
            error: e, cut off at the largest that counts [m, rad].
        """
        s, pitch = measurement.state, reference.position.pitch
        alpha = angle_of_attack(self.model, pitch)
        slope = jnp.where(pitch < 0.0, -1.0, 1.0) * jnp.maximum(
            jnp.abs(pitch - alpha), FLATTEST_PATH
        )
        speed = jnp.abs(reference.rate.depth / sincos(slope)[0])
        sine, cosine = sincos(alpha)
        return StateRow(
            error.depth,
            wrap(s.roll),
            error.pitch,
            error.heading,
            s.surge - speed * cosine,
            s.sway,
            s.heave - speed * sine,
            s.roll_rate,
            s.pitch_rate,
            s.yaw_rate,
        )
