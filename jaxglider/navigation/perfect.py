"""The estimator that knows: what every other one is measured by."""

from jaxglider.core.containers import Scalar
from jaxglider.navigation.estimator import AbstractEstimator, Moves
from jaxglider.navigation.sensing.readings import Readings
from jaxglider.signals import GliderState


class Perfect(AbstractEstimator):
    """The true state, velocity through the water. No glider has it."""

    def init(self, state: GliderState) -> GliderState:
        """The true state."""
        return state

    def estimate(self, estimator_state: GliderState) -> GliderState:
        """The true state."""
        return estimator_state

    def step(
        self,
        estimator_state: GliderState,
        readings: Readings,
        moves: Moves,
        truth: GliderState,
        dt: Scalar,
    ) -> GliderState:
        """The true state at the end of the tick."""
        return truth
