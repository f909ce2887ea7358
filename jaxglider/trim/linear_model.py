"""The equations of motion linearised about a steady motion.

x' = A x + B U for small deviations of (Z, φ, θ, ψ, u, v, w, p, q, r) and of the command
from a steady motion. Position north and east drive nothing and are left out.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.signals import BodyAxes, Command, GliderState, zeros
from jaxglider.trim.steady_motion import SteadyMotion
from jaxglider.vehicle.plant import AbstractPlant

STATES = (
    "depth",
    "roll",
    "pitch",
    "heading",
    "surge",
    "sway",
    "heave",
    "roll_rate",
    "pitch_rate",
    "yaw_rate",
)
INPUTS = ("buoyancy_mass", "mass_position", "mass_angle")


class Linear(NamedTuple):
    """A [1/s] and B [per kg, m, rad], in the order of `STATES` and `INPUTS`."""

    a: Float[Array, "10 10"]
    b: Float[Array, "10 3"]


def linearise(plant: AbstractPlant, motion: SteadyMotion) -> Linear:
    """A and B by forward differentiation.

    Args:
        plant: the glider.
        motion: steady motion to linearise about.
    """

    def rate(at: Array) -> Array:
        x, command = at[: len(STATES)], at[len(STATES) :]
        state = GliderState.at_rest(**dict(zip(STATES, x, strict=True)))
        turned = plant.derivative(state, Command(*command), zeros(BodyAxes, x[0]))
        return jnp.stack([getattr(turned, name) for name in STATES])

    at = [getattr(motion.state, name) for name in STATES]
    at += [getattr(motion.command, name) for name in INPUTS]
    about = jnp.stack(at)
    # One column after the other: as a loop it compiles in half the time.
    columns = lax.map(
        lambda along: jax.jvp(rate, (about,), (along,))[1],
        jnp.eye(about.size, dtype=about.dtype),
    )
    return Linear(columns[: len(STATES)].T, columns[len(STATES) :].T)
