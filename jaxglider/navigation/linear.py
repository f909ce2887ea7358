"""The linear extended state observer, which needs no model: one pole, three times.

With β = e^(−ω T) and T the time since the last reading, a surprise e corrects

ŷ += (1 − β³) e,   ŷ' += 3/2 (1 − β)² (1 + β) e/T,   d̂ += (1 − β)³ e/T²,

which puts all three poles of the error at β. The error falls as 1/ω, the noise grows
with it.

Source: Z. Gao, Scaling and bandwidth-parameterization based controller tuning (ACC
2003), with the current-estimator form of the discrete one (R. Miklosovic, A. Radke and
Z. Gao, ACC 2006).
"""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.sets import POSITIVE
from jaxglider.navigation.output_observer import Correction, OutputObserver
from jaxglider.navigation.sensing.readings import Sensed
from jaxglider.signals import map_fields


class LinearObserver(OutputObserver):
    """The linear extended state observer.

    Attributes:
        bandwidth: ω of each output [rad/s].
    """

    bandwidth: Sensed[Scalar] = eqx.field(metadata={"set": POSITIVE})

    def corrections(
        self, surprises: Sensed[Scalar], intervals: Sensed[Scalar]
    ) -> Sensed[Correction]:
        """The three gains times the surprise."""
        return map_fields(_corrected, self.bandwidth, surprises, intervals)


def _corrected(bandwidth: Scalar, surprise: Scalar, interval: Scalar) -> Correction:
    pole, left = jnp.exp(-bandwidth * interval), -jnp.expm1(-bandwidth * interval)
    return Correction(
        (1.0 - pole**3) * surprise,
        1.5 * left * left * (1.0 + pole) * surprise / interval,
        left**3 * surprise / (interval * interval),
    )
