"""The signals of the closed loop: what flows between glider, observer and controller.

Named scalar fields instead of index constants; a formula that is the same on every
channel or axis is one function mapped over the fields with `map_fields`.

| signal | symbol of the paper |
|---|---|
| `GliderState` | X, Y, Z, φ, θ, ψ and ν = (u, v, w, p, q, r) |
| `Channels` | η = (Z, θ, ψ) and everything that exists once per controlled output |
| `BodyAxes` | τ, d, ι and everything that exists once per degree of freedom |
| `Command` | U = (m_b, r_p1, γ) |
"""

import dataclasses
import operator
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core import rotations as frames
from jaxglider.core.containers import Container, Scalar, as_float

T = TypeVar("T")
C = TypeVar("C")


def _number() -> Any:
    return eqx.field(converter=as_float)


class GliderState(Container):
    """Position, attitude and velocity of a glider; its time derivative has this type.

    Attributes:
        north: position north X [m], NED frame.
        east: position east Y [m].
        depth: depth Z [m], positive down.
        roll: φ [rad].
        pitch: θ [rad], positive nose up.
        heading: ψ [rad], clockwise from north, not wrapped.
        surge: u [m/s], body frame, forward.
        sway: v [m/s], to starboard.
        heave: w [m/s], downward.
        roll_rate: p [rad/s], body frame.
        pitch_rate: q [rad/s].
        yaw_rate: r [rad/s].
    """

    north: Scalar = _number()
    east: Scalar = _number()
    depth: Scalar = _number()
    roll: Scalar = _number()
    pitch: Scalar = _number()
    heading: Scalar = _number()
    surge: Scalar = _number()
    sway: Scalar = _number()
    heave: Scalar = _number()
    roll_rate: Scalar = _number()
    pitch_rate: Scalar = _number()
    yaw_rate: Scalar = _number()

    @classmethod
    def at_rest(cls, **values: Any) -> "GliderState":
        """A state with some fields by name, and zero everywhere else.

        Args:
            values: numbers by the names of the fields, in their units.

        Raises:
            ValueError: a name is no field.
        """
        names = [field.name for field in dataclasses.fields(cls)]
        unknown = sorted(set(values) - set(names))
        if unknown:
            raise ValueError(
                f"GliderState has no field {unknown[0]!r}; choose from {names}."
            )
        return cls(**{name: values.get(name, 0.0) for name in names})

    def unturned(self) -> "GliderState":
        """The same state with full turns taken off roll and pitch, into [−π, π)."""
        return dataclasses.replace(
            self, roll=frames.wrap(self.roll), pitch=frames.wrap(self.pitch)
        )

    def attitude(self) -> frames.Attitude:
        """Sines and cosines of the Euler angles."""
        return frames.attitude(self.roll, self.pitch, self.heading)

    def velocity(self) -> "BodyAxes[Scalar]":
        """ν: linear velocity [m/s] and angular rates [rad/s], body frame."""
        return BodyAxes(
            self.surge,
            self.sway,
            self.heave,
            self.roll_rate,
            self.pitch_rate,
            self.yaw_rate,
        )


class Channels(Container, Generic[T]):
    """One thing for each controlled output: depth [m], pitch [rad], heading [rad]."""

    depth: T = _number()
    pitch: T = _number()
    heading: T = _number()


class BodyAxes(Container, Generic[T]):
    """One thing for each degree of freedom, body frame.

    As a force: surge, sway, heave [N], roll, pitch, yaw [N m]. Sums and quotients are
    taken axis by axis.
    """

    surge: T = _number()
    sway: T = _number()
    heave: T = _number()
    roll: T = _number()
    pitch: T = _number()
    yaw: T = _number()

    def __add__(self, other: "BodyAxes[T]") -> "BodyAxes[T]":
        return map_fields(operator.add, self, other)

    def __sub__(self, other: "BodyAxes[T]") -> "BodyAxes[T]":
        return map_fields(operator.sub, self, other)

    def __truediv__(self, other: "BodyAxes[T]") -> "BodyAxes[T]":
        # Divided by what seldom changes, masses and the like: their reciprocals move
        # out of the loop.
        return map_fields(lambda a, b: a * (1.0 / b), self, other)

    def fields(self) -> tuple[T, T, T, T, T, T]:
        """The six things in order."""
        return self.surge, self.sway, self.heave, self.roll, self.pitch, self.yaw


class Command(Container, Generic[T]):
    """U: what the actuators are asked for, or hold.

    Attributes:
        buoyancy_mass: m_b [kg], positive sinks.
        mass_position: r_p1 [m], moving mass along the body axis, positive forward.
        mass_angle: γ [rad], roll angle of the moving mass.
    """

    buoyancy_mass: T = _number()
    mass_position: T = _number()
    mass_angle: T = _number()


CHANNEL_UNITS = {"depth": "m", "pitch": "rad", "heading": "rad"}
"""SI unit of each controlled output, by the fields of `Channels`."""
CHANNELS = tuple(CHANNEL_UNITS)
"""Names of the controlled outputs."""
COMMAND_UNITS = {"buoyancy_mass": "kg", "mass_position": "m", "mass_angle": "rad"}
"""SI unit of each command, by the fields of `Command`."""


class Orders(eqx.Module):
    """Orders of a plan that sets the ballast itself: what a law is not asked for.

    Attributes:
        buoyancy_mass: m_b that the pump is to reach [kg], whatever the law wants.
        settled_mass: m_b that the half which has begun will be flown with [kg]; another
            one than that at an inflection where the pump waits.
        mass_held: flag, the moving mass stays where it is for now.
        phase: number of the phase of the yo, an index of `guidance.phases.PHASES`.
        status: end of the mission, an index of `guidance.phases.STATUSES`.
        steering: mass or fin angle ordered in place of the law's [rad], or None.
        steering_limit: largest modulus of that angle for now [rad], infinite for none;
            None where the plan never limits it.
    """

    buoyancy_mass: Scalar
    settled_mass: Scalar
    mass_held: jax.Array
    phase: jax.Array
    status: jax.Array
    steering: Scalar | None = None
    steering_limit: Scalar | None = None


class Reference(eqx.Module):
    """Wanted outputs of the glider at one instant.

    Attributes:
        position: η_d: depth [m], pitch [rad], heading [rad].
        rate: η_d' [m/s, rad/s].
        acceleration: η_d'' [m/s², rad/s²].
        clock: t* [s], time since the performance funnel was last restarted.
        target: number of the waypoint or schedule segment being followed.
        finished: the mission is over.
        orders: ballast and other orders beside the outputs; None where depth is tracked
            with the pump, as in the paper.
    """

    position: Channels[Scalar]
    rate: Channels[Scalar]
    acceleration: Channels[Scalar]
    clock: Scalar
    target: jax.Array
    finished: jax.Array
    orders: Orders | None = None


class Measurement(eqx.Module):
    """All that a controller may know about the glider.

    Attributes:
        state: measured state.
        attitude: sines and cosines of its Euler angles.
        applied: command held by the actuators at the end of the previous tick.
        disturbance: d̂, the observer's estimate so far; force [N] and moment [N m].
        altitude: height over the bottom [m], or None without a bottom.
        charge: energy left in the battery [J], or None where nothing counts it.
        buoyancy_mass: ballast that the plan has ordered [kg], or None where the law
            pumps as it likes.
        current: velocity of the water that the glider reckons with, north and east
            [m/s]: then the velocity of `state` is the one through the water; or None.
        aground: flag, the glider has met the bottom; None to tell it by the altitude.
    """

    state: GliderState
    attitude: frames.Attitude
    applied: Command[Scalar]
    disturbance: BodyAxes[Scalar]
    altitude: Scalar | None = None
    charge: Scalar | None = None
    buoyancy_mass: Scalar | None = None
    current: tuple[Scalar, Scalar] | None = None
    aground: jax.Array | None = None


def map_fields(function: Callable[..., Any], first: Any, *rest: Any) -> Any:
    """Apply a function field by field to containers of one kind.

    Args:
        function: function called once per field, with that field of each container.
        first: first container; its type is the type of the result.
        rest: further containers with the same field names.
    """
    names = [field.name for field in dataclasses.fields(first)]
    return type(first)(
        **{
            name: function(*(getattr(c, name) for c in (first, *rest)))
            for name in names
        }
    )


def zeros(kind: type[C], like: Any = 0.0) -> C:
    """A container of zeros with the precision of `like`.

    Args:
        kind: class of the container.
        like: number whose precision it takes.
    """
    zero = jnp.zeros_like(as_float(like))
    return kind(*(zero for _ in dataclasses.fields(kind)))  # type: ignore[arg-type]


def depth_rate(state: GliderState) -> Scalar:
    """Z' [m/s], positive down."""
    return frames.body_to_ned(state.attitude(), state.surge, state.sway, state.heave)[2]


def output_rates(measurement: Measurement) -> Channels[Scalar]:
    """η' = J(η) ν: rates of depth [m/s], pitch and heading [rad/s]."""
    s, a = measurement.state, measurement.attitude
    _, _, depth_rate = frames.body_to_ned(a, s.surge, s.sway, s.heave)
    _, pitch_rate, heading_rate = frames.euler_rates(
        a, s.roll_rate, s.pitch_rate, s.yaw_rate
    )
    return Channels(depth_rate, pitch_rate, heading_rate)
