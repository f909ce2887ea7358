"""Steady motions: straight glides and spirals, for given commands or wanted paths.

In a steady motion the body velocities, roll and pitch rest while the heading turns
evenly: ν' = 0 with (p, q, r) = ω (−sinθ, cosθ sinφ, cosθ cosφ). That is six equations
for (u, v, w, φ, θ, ω); three more fix the command, or what is wanted instead of it.

Newton's method from several glides, each step shortened until it helps. The derivative
is that of the exact solution, by the implicit function theorem.
"""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.core import rotations as frames
from jaxglider.core.containers import Container, Flag, Scalar, as_float
from jaxglider.core.numerics import square_root
from jaxglider.signals import BodyAxes, Command, GliderState, zeros
from jaxglider.vehicle.plant import AbstractPlant

_STEPS, _HALVINGS = 30, 6
_STARTS = (0.2, 0.35, 0.6, 0.9, 1.2)
"""Glide angles [rad] that the search starts from where none is given."""


def _maybe() -> Any:
    return eqx.field(converter=as_float, default=None)


class Target(Container):
    """Wanted properties of a steady motion: one of each pair of fields.

    Attributes:
        buoyancy_mass: m_b [kg], or else
        speed: V [m/s].
        mass_position: r_p1 [m], or else
        glide_angle: ξ [rad] of the path, negative for a dive.
        mass_angle: γ [rad], or else
        turn_rate: ω [rad/s], positive to starboard, or else
        turn_radius: R [m], positive to starboard.

    Raises:
        ValueError: both or neither of a pair are given.
    """

    buoyancy_mass: Scalar | None = _maybe()
    speed: Scalar | None = _maybe()
    mass_position: Scalar | None = _maybe()
    glide_angle: Scalar | None = _maybe()
    mass_angle: Scalar | None = _maybe()
    turn_rate: Scalar | None = _maybe()
    turn_radius: Scalar | None = _maybe()

    def __check_init__(self) -> None:
        for choice in (
            ("buoyancy_mass", "speed"),
            ("mass_position", "glide_angle"),
            ("mass_angle", "turn_rate", "turn_radius"),
        ):
            names = [name for name in choice if getattr(self, name) is not None]
            if len(names) != 1:
                raise ValueError(
                    f"Target needs exactly one of {', '.join(choice)}; received "
                    f"{' and '.join(names) if names else 'none of them'}."
                )

    @classmethod
    def of_command(cls, command: Command[Scalar]) -> "Target":
        """The steady motion under a command."""
        return cls(
            buoyancy_mass=command.buoyancy_mass,
            mass_position=command.mass_position,
            mass_angle=command.mass_angle,
        )


class SteadyMotion(eqx.Module):
    """A steady motion and how well it is met.

    Attributes:
        state: state at the origin with heading zero.
        command: command that holds it [kg, m, rad].
        turn_rate: ω [rad/s].
        residual: largest acceleration left over [m/s², rad/s²].
        converged: flag, the residual is next to nothing and the glider moves forward
            upright.
    """

    state: GliderState
    command: Command[Scalar]
    turn_rate: Scalar
    residual: Scalar
    converged: Flag

    def speed(self) -> Scalar:
        """V [m/s]."""
        s = self.state
        return square_root(s.surge**2 + s.sway**2 + s.heave**2)

    def angle_of_attack(self) -> Scalar:
        """α [rad]."""
        return frames.direction(self.state.surge, self.state.heave)

    def sideslip(self) -> Scalar:
        """β [rad]."""
        s = self.state
        ahead = square_root(s.surge**2 + s.heave**2)
        return frames.direction(ahead, s.sway)

    def sink_rate(self) -> Scalar:
        """Z' [m/s]."""
        s = self.state
        return frames.body_to_ned(s.attitude(), s.surge, s.sway, s.heave)[2]

    def horizontal_speed(self) -> Scalar:
        """Speed over ground [m/s]."""
        s = self.state
        north, east, _ = frames.body_to_ned(s.attitude(), s.surge, s.sway, s.heave)
        return square_root(north**2 + east**2)

    def glide_angle(self) -> Scalar:
        """ξ [rad] of the path, negative for a dive."""
        return frames.direction(self.horizontal_speed(), -self.sink_rate())

    def turn_radius(self) -> Scalar:
        """R [m] of the path from above, positive to starboard, infinite if straight."""
        return self.horizontal_speed() / self.turn_rate


def steady_motion(plant: AbstractPlant, target: Target) -> SteadyMotion:
    """The steady motion of a glider that is like the target; differentiable.

    Where there are several, the one with the smallest angles between body and flow.
    Check `converged`: a glide may be too shallow for the glider, or too slow.

    Args:
        plant: the glider.
        target: commands or what is wanted instead of them.
    """
    fixed, wanted = jax.tree.map(lax.stop_gradient, (plant, target))
    # One after the other, as are the steps tried: loops compile faster than lanes.
    ends, left = lax.map(
        lambda x: _newton(lambda y: _residual(fixed, wanted, y), x),
        _starts(fixed, wanted),
    )
    motions = jax.vmap(_describe)(ends, left)
    slant = jnp.abs(jax.vmap(SteadyMotion.angle_of_attack)(motions))
    slant += jnp.abs(jax.vmap(SteadyMotion.sideslip)(motions))
    best = jnp.argmin(jnp.where(motions.converged, slant, jnp.inf))
    root = lax.custom_root(
        lambda y: _residual(plant, target, y),
        ends[best],
        lambda _, at_the_root: at_the_root,
        lambda linear, y: jnp.linalg.solve(jax.jacobian(linear)(y), y),
    )
    return _describe(root, lax.stop_gradient(left[best]))


def _unpack(x: Float[Array, "9"]) -> tuple[GliderState, Command[Scalar], Scalar]:
    """State, command and turn rate of the unknowns (u, v, w, φ, θ, ω, U)."""
    u, v, w, roll, pitch, omega, *command = x
    turning = frames.attitude(roll, pitch, 0.0 * roll)
    state = GliderState.at_rest(
        roll=roll,
        pitch=pitch,
        surge=u,
        sway=v,
        heave=w,
        roll_rate=-omega * turning.sin_pitch,
        pitch_rate=omega * turning.cos_pitch * turning.sin_roll,
        yaw_rate=omega * turning.cos_pitch * turning.cos_roll,
    )
    return state, Command(*command), omega


def _describe(x: Float[Array, "9"], left: Scalar) -> SteadyMotion:
    """The motion of some unknowns, whose largest residual is given."""
    state, command, omega = _unpack(x)
    exact = left < jnp.finfo(x.dtype).eps ** 0.6
    forward = (state.surge > 0.0) & (jnp.cos(state.roll) > 0.0)
    forward &= jnp.abs(state.pitch) < 0.5 * math.pi
    return SteadyMotion(
        state=state,
        command=command,
        turn_rate=omega,
        residual=left,
        converged=exact & forward,
    )


def _residual(plant: AbstractPlant, target: Target, x: Array) -> Array:
    """Accelerations, and by how much the target is missed."""
    state, command, omega = _unpack(x)
    rate = plant.derivative(state, command, zeros(BodyAxes, x[0]))
    motion = SteadyMotion(
        state=state,
        command=command,
        turn_rate=omega,
        residual=x[0],
        converged=jnp.asarray(True),
    )
    missed = []
    if target.speed is not None:
        missed.append(motion.speed() - target.speed)
    else:
        missed.append(command.buoyancy_mass - target.buoyancy_mass)
    if target.glide_angle is not None:
        missed.append(motion.glide_angle() - target.glide_angle)
    else:
        missed.append(command.mass_position - target.mass_position)
    if target.turn_rate is not None:
        missed.append(omega - target.turn_rate)
    elif target.turn_radius is not None:
        missed.append(omega - motion.horizontal_speed() / target.turn_radius)
    else:
        missed.append(command.mass_angle - target.mass_angle)
    return jnp.stack([*rate.velocity().fields(), *missed])


def _newton(
    function: Callable[[Array], Array], x: Array
) -> tuple[Float[Array, "9"], Scalar]:
    """Newton's method; of each step the fraction that leaves the least.

    Value and slope are taken at every fraction tried: that costs little here, and the
    program holds the equations of motion once only, which compiles in a third of the
    time.

    Returns:
        The unknowns and their largest residual.
    """

    def with_value(x: Array) -> tuple[Array, Array]:
        value = function(x)
        return value, value

    def step(carry: tuple[Array, Array, Array], _: None) -> tuple[Any, None]:
        x, value, slope = carry
        move = jnp.linalg.solve(slope, value)
        shares = 0.5 ** jnp.arange(_HALVINGS, dtype=x.dtype)
        candidates = jnp.concatenate([x - shares[:, None] * move, x[None]])
        slopes, values = lax.map(jax.jacfwd(with_value, has_aux=True), candidates)
        size = jnp.linalg.norm(values, axis=1)
        best = jnp.argmin(jnp.where(jnp.isfinite(size), size, jnp.inf))
        return (candidates[best], values[best], slopes[best]), None

    # With no value yet the first step goes nowhere.
    carry = (x, jnp.zeros_like(x), jnp.eye(x.size, dtype=x.dtype))
    (end, value, _), _ = lax.scan(step, carry, None, length=_STEPS + 1)
    return end, jnp.max(jnp.abs(value))


def _starts(plant: AbstractPlant, target: Target) -> Float[Array, "n 9"]:
    """Straight glides, steep and shallow, down and up, with roll and without."""
    c = plant.parameters

    def start(slope: Scalar, share: Scalar) -> Array:
        sense = -jnp.sign(slope)
        if target.buoyancy_mass is not None:
            sense = jnp.sign(target.buoyancy_mass)
        slope = -sense * jnp.abs(slope)
        if target.glide_angle is not None:
            slope = target.glide_angle
        alpha = -c.drag / c.lift_slope / jnp.tan(slope)
        drag = 2.0 * c.drag
        zero = jnp.zeros_like(slope)
        speed, mass = target.speed, target.buoyancy_mass
        if speed is None:
            lost = jnp.abs(mass * c.gravity * jnp.sin(slope))
            speed = jnp.sqrt(lost / drag + 1e-6)
        if mass is None:
            mass = -drag * speed * speed / (c.gravity * jnp.sin(slope))
        gamma = zero if target.mass_angle is None else target.mass_angle
        omega = zero if target.turn_rate is None else target.turn_rate
        position = zero if target.mass_position is None else target.mass_position
        return jnp.stack(
            [
                speed * jnp.cos(alpha),
                zero,
                speed * jnp.sin(alpha),
                share * gamma,
                slope + alpha,
                omega,
                mass,
                position,
                gamma,
            ]
        )

    kind = c.gravity.dtype
    slopes = jnp.asarray([s * x for s in (-1.0, 1.0) for x in _STARTS], kind)
    shares = jnp.asarray([0.0, 0.4], kind)
    grid = jax.vmap(jax.vmap(start, (None, 0)), (0, None))(slopes, shares)
    return grid.reshape(-1, 9)
