"""The design model about a straight glide, as a linear-quadratic design wants it.

x' = A x + B u for small deviations of depth, attitude and velocity from the trim of a
straight glide at a pitch and a depth rate; u those of ballast, place and angle of the
mass. A and B are derivatives of the design model, which is all that a law may know.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645, who design an LQR so about each of their glides.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxglider.control.balance import angle_of_attack, trim_ballast, trim_position
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.riccati import regulator_gain, sampled
from jaxglider.core.rotations import body_to_ned, euler_rates
from jaxglider.signals import Channels, Command, GliderState, zeros
from jaxglider.vehicle.design_model import DesignModel


class StateRow(Container):
    """One number for each state that a regulator feeds back; none for place and drift.

    Attributes:
        depth: entry of Z [per m].
        roll: entry of φ [per rad].
        pitch: entry of θ [per rad].
        heading: entry of ψ [per rad].
        surge: entry of u [per m/s].
        sway: entry of v [per m/s].
        heave: entry of w [per m/s].
        roll_rate: entry of p [per rad/s].
        pitch_rate: entry of q [per rad/s].
        yaw_rate: entry of r [per rad/s].
    """

    depth: Scalar = eqx.field(converter=as_float)
    roll: Scalar = eqx.field(converter=as_float)
    pitch: Scalar = eqx.field(converter=as_float)
    heading: Scalar = eqx.field(converter=as_float)
    surge: Scalar = eqx.field(converter=as_float)
    sway: Scalar = eqx.field(converter=as_float)
    heave: Scalar = eqx.field(converter=as_float)
    roll_rate: Scalar = eqx.field(converter=as_float)
    pitch_rate: Scalar = eqx.field(converter=as_float)
    yaw_rate: Scalar = eqx.field(converter=as_float)


STATES = tuple(field.name for field in dataclasses.fields(StateRow))
"""Names of the states that are fed back, in the order of A and B."""


class Row(eqx.Module):
    """A row of K: of the states, and of the integrals where there are any.

    Attributes:
        state: entries of the states.
        integral: entries of ∫e dt of each channel, or None.
    """

    state: StateRow
    integral: Channels[Scalar] | None = None

    def times(self, error: StateRow, integral: Channels[Scalar] | None) -> Scalar:
        """The row times the deviations.

        Args:
            error: deviations of the states.
            integral: integrals of the errors, or None.
        """
        total = _dot(self.state, error)
        if self.integral is None or integral is None:
            return total
        return total + _dot(self.integral, integral)


class Feedback(eqx.Module):
    """K about a dive and about a climb.

    Attributes:
        dive: rows of K in dives, one for each actuator.
        climb: rows in climbs.
    """

    dive: Command[Row]
    climb: Command[Row]


class Trim(NamedTuple):
    """A straight glide.

    Attributes:
        state: state of the glider in it.
        command: positions of the actuators in it [kg, m, rad].
    """

    state: GliderState
    command: Command[Scalar]


def trim_of(model: DesignModel, pitch: Scalar, depth_rate: Scalar) -> Trim:
    """The straight glide of a pitch and a depth rate.

    Args:
        model: design model.
        pitch: θ [rad].
        depth_rate: |Z'| [m/s].
    """
    alpha = angle_of_attack(model, pitch)
    ballast = trim_ballast(model, pitch, alpha, depth_rate)
    place = trim_position(model, pitch, ballast, alpha)
    speed = jnp.abs(depth_rate / jnp.sin(pitch - alpha))
    state = dataclasses.replace(
        zeros(GliderState, pitch),
        pitch=pitch,
        surge=speed * jnp.cos(alpha),
        heave=speed * jnp.sin(alpha),
    )
    return Trim(state, Command(ballast, place, jnp.zeros_like(place)))


def linear_model(
    model: DesignModel, trim: Trim
) -> tuple[Float[Array, "10 10"], Float[Array, "10 3"]]:
    """A [1/s] and B about a glide.

    Args:
        model: design model.
        trim: glide to linearise about.
    """

    def rate(at: Array) -> Array:
        x = dict(zip(STATES, at[: len(STATES)], strict=True))
        zero = jnp.zeros_like(trim.state.pitch)
        state = GliderState(north=zero, east=zero, **x)
        attitude = state.attitude()
        force = model.force(state, attitude, Command(*at[len(STATES) :]))
        nu = force / model.parameters.inertia()
        down = body_to_ned(attitude, state.surge, state.sway, state.heave)[2]
        turning = euler_rates(
            attitude, state.roll_rate, state.pitch_rate, state.yaw_rate
        )
        return jnp.stack([down, *turning, *nu.fields()])

    about = jnp.stack(
        [getattr(trim.state, name) for name in STATES]
        + [getattr(trim.command, f.name) for f in dataclasses.fields(Command)]
    )
    columns = jax.vmap(lambda along: jax.jvp(rate, (about,), (along,))[1])(
        jnp.eye(about.size, dtype=about.dtype)
    )
    return columns[: len(STATES)].T, columns[len(STATES) :].T


class ScaledStep(NamedTuple):
    """One period of the linear model, in the roots of the weights as units.

    So the cost is the sum of all squares, and single precision is enough for a design.

    Attributes:
        a: A of one period.
        b: B of one period.
        states: units of the states over SI ones, one for each.
        inputs: units of the actuators over SI ones.
    """

    a: Float[Array, "n n"]
    b: Float[Array, "n 3"]
    states: Float[Array, " n"]
    inputs: Float[Array, " 3"]

    def costs(self) -> tuple[Float[Array, "n n"], Float[Array, "3 3"]]:
        """Q and R in these units: ones on the diagonal."""
        dtype = self.a.dtype
        return jnp.eye(self.states.size, dtype=dtype), jnp.eye(3, dtype=dtype)


def scaled_step(
    model: DesignModel,
    trim: Trim,
    period: Scalar,
    weights: StateRow,
    efforts: Command[Scalar],
    integrals: Channels[Scalar] | None = None,
) -> ScaledStep:
    """The linear model about a glide over one period.

    Args:
        model: design model.
        trim: glide.
        period: time from one run to the next [s].
        weights: diagonal of Q, one for each state.
        efforts: diagonal of R, one for each actuator.
        integrals: weights of ∫e dt of each channel, or None for no integrals.
    """
    a, b = linear_model(model, trim)
    n = len(STATES)
    scale = jnp.stack(fields_of(weights))
    if integrals is not None:
        pick = jnp.eye(n, dtype=a.dtype)[jnp.asarray([STATES.index(c) for c in _OUT])]
        zero = jnp.zeros((len(_OUT), len(_OUT)), a.dtype)
        a = jnp.block([[a, jnp.zeros((n, len(_OUT)), a.dtype)], [pick, zero]])
        b = jnp.vstack([b, jnp.zeros((len(_OUT), b.shape[1]), b.dtype)])
        scale = jnp.concatenate([scale, jnp.stack(fields_of(integrals))])
    x, u = jnp.sqrt(scale), jnp.sqrt(jnp.stack(fields_of(efforts)))
    a, b = x[:, None] * a / x, x[:, None] * b / u
    return ScaledStep(*sampled(a, b, period), x, u)


def designed(step: ScaledStep) -> Command[Row]:
    """Rows of K about a glide, for a law that runs once in a period.

    Args:
        step: linear model over the period.
    """
    gain = regulator_gain(step.a, step.b, *step.costs())
    gain = gain * step.states / step.inputs[:, None]
    return Command(*(_row(line, step.states.size > len(STATES)) for line in gain))


_OUT = ("depth", "pitch", "heading")


def _row(line: Array, with_integrals: bool) -> Row:
    n = len(STATES)
    integral = Channels(*line[n:]) if with_integrals else None
    return Row(StateRow(*line[:n]), integral)


def fields_of(thing: Container) -> list[Scalar]:
    """The numbers of a container in the order of its fields."""
    return [getattr(thing, field.name) for field in dataclasses.fields(thing)]


def _dot(first: Container, second: Container) -> Scalar:
    return sum(
        (x * y for x, y in zip(fields_of(first), fields_of(second), strict=True)),
        start=jnp.zeros_like(fields_of(first)[0]),
    )
