"""Actuators: saturation always; rate limit, lag and failure where given."""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import (
    Container,
    Scalar,
    as_float,
    check_interval,
    choose,
)
from jaxglider.core.numerics import saturate
from jaxglider.signals import Command, map_fields
from jaxglider.vehicle.parameters import VehicleData

NEVER = 1e9
"""A time that no run reaches [s]."""


class Failure(Container):
    """Failure of an actuator: it grows weak, or gets stuck, at a time.

    Attributes:
        weak_from: time from which the actuator reaches only a share of its command [s].
        effectiveness: share of the command that a weak actuator reaches, in [0, 1].
        stuck_from: time from which the actuator stays where it is [s].

    Raises:
        ValueError: the effectiveness is outside [0, 1], or a number is not finite.
    """

    weak_from: Scalar = eqx.field(converter=as_float, default=NEVER)
    effectiveness: Scalar = eqx.field(converter=as_float, default=1.0)
    stuck_from: Scalar = eqx.field(converter=as_float, default=NEVER)

    def __check_init__(self) -> None:
        check_interval(
            "Failure",
            "effectiveness",
            self.effectiveness,
            0.0,
            1.0,
            closed_low=True,
            closed_high=True,
        )

    def reached(self, target: Scalar, time: Scalar | float) -> Scalar:
        """Target that a weak actuator reaches [kg, m or rad]."""
        return jnp.where(time >= self.weak_from, self.effectiveness * target, target)

    def kept(self, held: Scalar, moved: Scalar, time: Scalar | float) -> Scalar:
        """Position of an actuator that may be stuck [kg, m or rad]."""
        return jnp.where(time >= self.stuck_from, held, moved)


class Actuator(Container):
    """One actuator: a servo that follows its command within its limits.

    x ← x + clip((1 − e^(−Δt/τ)) (clip(u, ±limit) − x), ±rate_limit Δt)

    Within its dead band, |clip(u, ±limit) − x| ≤ dead_band, it stands.

    Attributes:
        limit: largest modulus of the position [kg, m or rad].
        rate_limit: largest modulus of its rate [1/s of that], or None for no limit.
        time_constant: τ [s] of the first-order lag, or None for no lag.
        failure: way of failing, or None for never.
        dead_band: distance from the command within which it stands [kg, m or rad], or
            None for an actuator that follows the smallest change.

    Raises:
        ValueError: a number is not positive, or the dead band is negative.
    """

    limit: Scalar = eqx.field(converter=as_float)
    rate_limit: Scalar | None = eqx.field(converter=as_float, default=None)
    time_constant: Scalar | None = eqx.field(converter=as_float, default=None)
    failure: Failure | None = None
    dead_band: Scalar | None = eqx.field(converter=as_float, default=None)

    def __check_init__(self) -> None:
        for name in ("limit", "rate_limit", "time_constant"):
            check_interval("Actuator", name, getattr(self, name), low=0.0)
        check_interval("Actuator", "dead_band", self.dead_band, 0.0, closed_low=True)

    def follow(
        self,
        held: Scalar,
        wanted: Scalar,
        dt: Scalar,
        time: Scalar | float = 0.0,
        depth: Scalar | float = 0.0,
    ) -> Scalar:
        """The position one tick later.

        Args:
            held: position now [kg, m or rad].
            wanted: command of the controller [kg, m or rad].
            dt: tick [s].
            time: present time [s]; only a failure asks for it.
            depth: depth of the glider [m]; only a pump asks for it.
        """
        target = saturate(wanted, self.limit)
        if self.failure is not None:
            target = self.failure.reached(target, time)
        moved = self.towards(target, held, dt, depth)
        if self.failure is not None:
            moved = self.failure.kept(held, moved, time)
        return moved

    def towards(
        self, target: Scalar, held: Scalar, dt: Scalar, depth: Scalar | float
    ) -> Scalar:
        """The position one tick later of an actuator that has not failed.

        Args:
            target: position within its limit that it makes for [kg, m or rad].
            held: position now [kg, m or rad].
            dt: tick [s].
            depth: depth of the glider [m]; only a pump asks for it.
        """
        wanted = target
        if self.time_constant is not None:
            target = held - jnp.expm1(-dt / self.time_constant) * (target - held)
        if self.rate_limit is not None:
            reach = self.rate_limit * dt
            target = jnp.clip(target, held - reach, held + reach)
        if self.dead_band is not None:
            target = jnp.where(jnp.abs(wanted - held) <= self.dead_band, held, target)
        return target


@jax.named_scope("actuators")
def follow_all(
    actuators: Command[Actuator],
    held: Command[Scalar],
    wanted: Command[Scalar],
    dt: Scalar,
    time: Scalar | float = 0.0,
    depth: Scalar | float = 0.0,
) -> Command[Scalar]:
    """`Actuator.follow` for each of the three.

    Args:
        actuators: actuators.
        held: positions now [kg, m, rad].
        wanted: command of the controller [kg, m, rad].
        dt: tick [s].
        time: present time [s]; only a failure asks for it.
        depth: depth of the glider [m]; only a pump asks for it.

    Returns:
        Positions one tick later [kg, m, rad].
    """
    return map_fields(
        lambda h, w, a: a.follow(h, w, dt, time, depth), held, wanted, actuators
    )


ACTUATOR_KINDS = ("vehicle", "ideal")
"""Names of what actuators can be: the vehicle's, with rates, or without."""


def make_actuators(vehicle: VehicleData, kind: str) -> Command[Actuator]:
    """The actuators of a vehicle.

    Args:
        vehicle: vehicle with their limits, and their rates if its file gives them.
        kind: `vehicle`, or `ideal` for actuators that jump to their command.

    Raises:
        ValueError: an unknown kind.
    """
    choose("actuators", kind, ACTUATOR_KINDS)
    if kind == "ideal" or vehicle.rates is None:
        return map_fields(Actuator, vehicle.limits)
    return map_fields(Actuator, vehicle.limits, vehicle.rates)
