"""Linear-quadratic regulators about the trims of dive and climb, without and with ∫e.

U = U* − K (x − x*), one K for dives and one for climbs, each from the discrete Riccati
equation of the design model about a straight glide, for a law that runs once in a
period. What is tuned are the weights of states and actuators, through the Riccati
equation. `LQI` has the integrals of the three errors among its states.

x* is the trim of the wanted glide; U* its ballast and place of the mass. Errors beyond
the largest that counts are not added to their integral. Glides, weights and x − x*
stand in `regulator`.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645 (LQR about each glide). Assumed: K does not follow the speed.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.balance import wanted_trim
from jaxglider.control.controller import ControlRecord, tracking_error
from jaxglider.control.parts import is_due, replaced
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.textbook.linear_design import Feedback, designed
from jaxglider.control.textbook.regulator import AbstractRegulator
from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import saturate
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    zeros,
)


def _integrals() -> Channels[Scalar]:
    """30 m s, 5 rad s and 20 rad s are."""
    return Channels(1.0 / 30.0**2, 1.0 / 5.0**2, 1.0 / 20.0**2)


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


class LQR(AbstractRegulator):
    """State feedback with least quadratic cost, about a dive and about a climb.

    Attributes:
        gain: K, or None to work it out from the weights before the first tick.

    Raises:
        ValueError: a number is outside its set.
    """

    gain: Feedback | None = eqx.field(default=None, metadata={"tuned": False})

    def feedback(self) -> Feedback:
        """K about the dive and about the climb."""
        return Feedback(*self.of_both(designed))

    def on_board(self) -> "LQR":
        """The law with K as it is: no Riccati equation is solved on board."""
        return dataclasses.replace(self, gain=self.feedback())

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
        deviation = self.deviation(measurement, reference, counted)
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
