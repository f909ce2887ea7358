"""Linear-quadratic regulators about the trims of dive and climb, without and with ∫e.

U = U* − K (x − x*), one K for dives and one for climbs, each from the discrete Riccati
equation of the design model about a straight glide, for a law that runs once in a
period. What is tuned are the weights of states and actuators, through the Riccati
equation. `LQI` has the integrals of the three errors among its states.

x* is the trim of the wanted glide: pitch and heading wanted, no roll, no rate, and the
velocity of a straight glide; U* its ballast and place of the mass. Errors count up to a
largest one each, so that the linear law is not asked for what only a small deviation
would bear; larger ones are not added to their integral.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645 (LQR about each glide). Assumed: weights on the diagonals only, first ones by
Bryson's rule, 1 over the square of what is bearable; K does not follow the speed.
"""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control import parts
from jaxglider.control.balance import FLATTEST_PATH, angle_of_attack, wanted_trim
from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.parts import is_due, replaced
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import AbstractSteering
from jaxglider.control.textbook.linear_design import (
    Feedback,
    StateRow,
    designed,
    trim_of,
)
from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import saturate, sincos
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    zeros,
)
from jaxglider.vehicle.design_model import DesignModel

_SLOPE = Interval(0.1, math.pi / 2)


def _weights() -> StateRow:
    """Q: 0.3 m, 0.3 rad, 0.1 rad, 0.3 rad, 0.1 m/s and 0.1 rad/s are bearable."""
    bearable = (0.3, 0.3, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
    return StateRow(*(1.0 / x**2 for x in bearable))


def _efforts() -> Command[Scalar]:
    """R: 0.05 kg, 1 cm and 0.3 rad are."""
    return Command(1.0 / 0.05**2, 1.0 / 0.01**2, 1.0 / 0.3**2)


def _integrals() -> Channels[Scalar]:
    """30 m s, 5 rad s and 20 rad s are."""
    return Channels(1.0 / 30.0**2, 1.0 / 5.0**2, 1.0 / 20.0**2)


def _largest() -> Channels[Scalar]:
    return Channels(1.0, 0.5, 0.4)


class RegulatorState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        elapsed: time since the law last ran; before it did, longer than any period [s].
        feedback: K, or None where the law has it.
        integral: ∫e dt of each channel, or None without.
        command: command of the last run [kg, m, rad].
    """

    elapsed: Scalar
    feedback: Feedback | None
    integral: Channels[Scalar] | None
    command: Command[Scalar]


class LQR(AbstractController):
    """State feedback with least quadratic cost, about a dive and about a climb.

    Attributes:
        model: design model, which trims and K are taken from.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        design_pitch: |θ| of the two glides that K is designed about [rad].
        design_rate: |Z'| of them [m/s].
        weights: diagonal of Q, 1 over the square of a bearable deviation each.
        efforts: diagonal of R, likewise [1/kg², 1/m², 1/rad²].
        largest: error that larger ones count as [m, rad].
        period: time from one run to the next [s]; not less than the tick, for K is
            designed for it.
        gain: K, or None to work it out from the weights before the first tick.

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
    gain: Feedback | None = eqx.field(default=None, metadata={"tuned": False})

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering | None = None,
    ) -> "LQR":
        """The law with weights by Bryson's rule, for the paper's glides.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer; not used, K steers.
        """
        return cls(model, funnel)

    def integral_weights(self) -> Channels[Scalar] | None:
        """Weights of ∫e dt of each channel; None for none."""
        return None

    def feedback(self) -> Feedback:
        """K about the dive and about the climb."""
        pitch = jnp.stack([-self.design_pitch, self.design_pitch])

        def about(pitch: Scalar) -> Command[Any]:
            return designed(
                self.model,
                trim_of(self.model, pitch, self.design_rate),
                self.period,
                self.weights,
                self.efforts,
                self.integral_weights(),
            )

        both = jax.vmap(about)(pitch)
        dive, climb = (jax.tree.map(lambda x, n=n: x[n], both) for n in (0, 1))
        return Feedback(dive, climb)

    def on_board(self) -> "LQR":
        """The law with K as it is: no Riccati equation is solved on board."""
        return dataclasses.replace(self, gain=self.feedback())

    def cycle_time(self) -> Scalar:
        """Time from one run to the next [s]."""
        return self.period

    def init(self) -> RegulatorState:
        """K, and nothing added up."""
        zero = jnp.zeros_like(self.period)
        return RegulatorState(
            elapsed=self.period,
            feedback=self.feedback() if self.gain is None else None,
            integral=None if self.integral_weights() is None else zeros(Channels, zero),
            command=zeros(Command, zero),
        )

    def step(
        self,
        state: RegulatorState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], RegulatorState, ControlRecord]:
        """One tick: a run of the law, or what its last run told."""
        error, rate = tracking_error(measurement, reference)
        due = is_due(state.elapsed, self.period, dt)
        counted = map_fields(saturate, error, self.largest)
        integral = state.integral
        if integral is not None:
            # Beyond the largest error the linear law is not to be believed.
            since = jnp.where(due, jnp.maximum(self.period, dt), 0.0)
            integral = map_fields(
                lambda i, e, c: i + jnp.where(e == c, since * e, 0.0),
                integral,
                error,
                counted,
            )
        trim = wanted_trim(self.model, measurement, reference)
        deviation = self._deviation(measurement, reference, counted)
        feedback = state.feedback if self.gain is None else self.gain
        assert feedback is not None  # `init` works it out where none is given.
        climbing = reference.position.pitch > 0.0
        wanted = map_fields(
            lambda star, dive, climb: (
                star
                - jnp.where(
                    climbing,
                    climb.times(deviation, integral),
                    dive.times(deviation, integral),
                )
            ),
            trim,
            feedback.dive,
            feedback.climb,
        )
        command: Command[Scalar] = replaced(due, wanted, state.command)
        elapsed = jnp.where(due, 0.0, state.elapsed) + dt
        following = RegulatorState(elapsed, state.feedback, integral, command)
        return command, following, ControlRecord(error, rate)

    def _deviation(
        self,
        measurement: Measurement,
        reference: Reference,
        error: Channels[Scalar],
    ) -> StateRow:
        """x − x*, the errors of the outputs as they count."""
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


class LQI(LQR):
    """The same with the integrals of the three errors among the states.

    Attributes:
        integrals: weights of ∫e dt of each channel, 1 over a bearable one squared.
    """

    integrals: Channels[Scalar] = eqx.field(
        default_factory=_integrals, metadata={"set": POSITIVE}
    )

    def integral_weights(self) -> Channels[Scalar]:
        """Weights of ∫e dt of each channel."""
        return self.integrals
