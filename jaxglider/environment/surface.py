"""The surface of the sea: a hull that comes out of the water loses buoyancy.

With h = max(−Z, 0) and s = min(h/D, 1) the share of the hull out of the water is taken
as s² (3 − 2 s), smooth at both ends, and the glider is heavier by that share of the
mass it displaces, m. Waves that it makes damp its heave: −m √(g/D) 4 s (1 − s) Z', by
the square of its beam at the waterline. Both are zero at a depth of zero and below:
what never comes up is not changed by a bit. Neither can add energy.

Left out: lift and drag are those of a hull under water, and the hull lies level.
"""

import jax.numpy as jnp

from jaxglider.core import rotations as frames
from jaxglider.core.containers import Scalar
from jaxglider.signals import BodyAxes, GliderState
from jaxglider.vehicle.plant import AbstractPlant

DIAMETER = 0.22
"""D [m], of SeaWing's hull and, to a centimetre, of Slocum's; taken for every glider. A
glider floats h ≈ D √(m_b/3m) out of the water: it matters little."""


def surface_force(plant: AbstractPlant, state: GliderState) -> BodyAxes[Scalar]:
    """Weight of the hull out of the water and what its waves take [N], body frame."""
    gravity, mass = plant.parameters.gravity, plant.displaced_mass()
    a = state.attitude()
    pull = emerged_weight(gravity, mass, state, a)
    zero = jnp.zeros_like(pull)
    return BodyAxes(*frames.ned_to_body(a, zero, zero, pull), zero, zero, zero)


def emerged_weight(
    gravity: Scalar, mass: Scalar, state: GliderState, a: frames.Attitude
) -> Scalar:
    """The same straight down [N].

    Args:
        gravity: g [m/s²].
        mass: m, mass of the water that the glider displaces [kg].
        state: state of the glider.
        a: attitude of it.
    """
    s = jnp.clip(-state.depth / DIAMETER, 0.0, 1.0)
    _, _, sinking = frames.body_to_ned(a, state.surge, state.sway, state.heave)
    weight = gravity * s * s * (3.0 - 2.0 * s)
    waves = jnp.sqrt(gravity / DIAMETER) * 4.0 * s * (1.0 - s) * sinking
    return mass * (weight - waves)
