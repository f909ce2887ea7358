"""Actuators: saturation always; rate limit and first-order lag where given."""

import equinox as eqx
import jax.numpy as jnp

from jaxglider._types import Container, Scalar, as_float, check_interval
from jaxglider.numerics import saturate
from jaxglider.signals import Command, each


class Actuator(Container):
    """One actuator: a servo that follows its command within its limits.

    x ← x + clip((1 − e^(−Δt/τ)) (clip(u, ±limit) − x), ±rate_limit Δt)

    Attributes:
        limit: largest modulus of the position [kg, m or rad].
        rate_limit: largest modulus of its rate [1/s of that], or None for no limit.
        time_constant: τ [s] of the first-order lag, or None for no lag.

    Raises:
        ValueError: a number is not positive.
    """

    limit: Scalar = eqx.field(converter=as_float)
    rate_limit: Scalar | None = eqx.field(converter=as_float, default=None)
    time_constant: Scalar | None = eqx.field(converter=as_float, default=None)

    def __check_init__(self) -> None:
        for name in ("limit", "rate_limit", "time_constant"):
            check_interval("Actuator", name, getattr(self, name), low=0.0)

    def follow(self, held: Scalar, wanted: Scalar, dt: Scalar) -> Scalar:
        """The position one tick later.

        Args:
            held: position now.
            wanted: command.
            dt: tick [s].
        """
        target = saturate(wanted, self.limit)
        if self.time_constant is not None:
            target = held - jnp.expm1(-dt / self.time_constant) * (target - held)
        if self.rate_limit is not None:
            reach = self.rate_limit * dt
            target = jnp.clip(target, held - reach, held + reach)
        return target


def follow_all(
    actuators: Command[Actuator],
    held: Command[Scalar],
    wanted: Command[Scalar],
    dt: Scalar,
) -> Command[Scalar]:
    """`Actuator.follow` for each of the three."""
    return each(lambda h, w, a: a.follow(h, w, dt), held, wanted, actuators)
