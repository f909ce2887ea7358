"""Protocol of an estimator, which makes of readings the state that a law needs.

It knows what a computer on board knows: the readings, the positions of the actuators,
the time, and a design model. The velocity that it gives is the one through the water.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxglider.core.containers import Container, Flag, Scalar
from jaxglider.navigation.sensing.readings import Reading, Readings
from jaxglider.signals import Command, GliderState

PATIENCE = 5.0
"""Number of samples in a row that an estimator does not believe; it believes the next:
then it is more likely to be wrong itself."""


ABSURD = 1e4
"""Surprise that no sensor can mean [m, rad]: it is broken, however long it lasts."""


class Moves(NamedTuple):
    """Positions of the actuators over a tick.

    Attributes:
        start: positions at its start [kg, m, rad].
        end: positions at its end [kg, m, rad].
    """

    start: Command[Scalar]
    end: Command[Scalar]


class AbstractEstimator(Container):
    """Estimates the state. Its array fields are its gains: what is tuned."""

    def stepped(self, steps: int) -> "AbstractEstimator":
        """The estimator for ticks of some integration steps; itself if it has none."""
        return self

    @abstractmethod
    def init(self, state: GliderState) -> Any:
        """The estimator's state before the first tick.

        Args:
            state: state of the glider on deck. Position, depth and attitude are known
                then; velocities are not looked at.
        """

    @abstractmethod
    def estimate(self, estimator_state: Any) -> GliderState:
        """The state so far; north and east are left to dead reckoning."""

    @abstractmethod
    def step(
        self,
        estimator_state: Any,
        readings: Readings,
        moves: Moves,
        truth: GliderState,
        dt: Scalar,
    ) -> Any:
        """The estimator's state one tick later.

        Args:
            estimator_state: state from `init` or from the previous step.
            readings: readings at the end of the tick.
            moves: positions of the actuators over the tick.
            truth: true state at its end, velocity through the water, for `Perfect`
                alone: no other estimator looks at it.
            dt: tick [s].
        """


class Innovation(NamedTuple):
    """Surprise of a reading, and whether it is believed.

    Attributes:
        value: innovation, zero where nothing is believed [unit of the quantity].
        believed: flag, there is a fresh reading, and it is believed.
        lost: flag, it is believed because so many before it were not.
        missed: number of those in a row that were not believed.
    """

    value: Scalar
    believed: Flag
    lost: Flag
    missed: Scalar


def innovation(
    reading: Reading, surprise: Scalar, limit: Scalar, missed: Scalar
) -> Innovation:
    """Innovation of a reading: nothing absurd, and no jump that does not last.

    Args:
        reading: reading of the sensor.
        surprise: value less the one expected; NaN is not believed.
        limit: largest surprise that is believed at once.
        missed: number of readings in a row that were not believed.
    """
    number = reading.fresh & (jnp.abs(surprise) <= ABSURD)
    value = jnp.where(number, surprise, 0.0)
    near = jnp.abs(value) <= limit
    lost = number & ~near & (missed >= PATIENCE)
    believed = number & (near | lost)
    refused = jnp.where(number, missed + 1.0, missed)
    return Innovation(
        jnp.where(believed, value, 0.0),
        believed,
        lost,
        jnp.where(believed, 0.0, refused),
    )
