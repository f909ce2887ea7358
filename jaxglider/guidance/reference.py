"""Protocol of a reference, which tells the glider what to do."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Container, Scalar, Series
from jaxglider.signals import GliderState, Measurement, Reference


class AbstractReference(Container):
    """Tells the glider what to do.

    What depends on time alone is planned for all ticks at once; the rest is stepped.

    Attributes:
        scheduled: the funnel's clock is known beforehand (`plan` carries `clock`), so
            performance functions can be computed for all ticks at once.
        can_finish: the mission can end before the horizon.
        phased: the reference flies yos: it gives orders, and its flight is measured.
    """

    scheduled: eqx.AbstractClassVar[bool]
    can_finish: eqx.AbstractClassVar[bool]
    phased: ClassVar[bool] = False

    @property
    def waypoints(self) -> int | None:
        """Number of waypoints to reach; None where there is no course."""
        return None

    def status(self, state: Any) -> Any:
        """Number of the end of the mission so far, of a state; None without ends."""
        return None

    def final_status(self, status: Any) -> Any:
        """Number of the end of the mission, once the run is over; None without ends.

        Args:
            status: number of the last tick in `phases.STATUSES`, or None.
        """
        return status

    @abstractmethod
    def plan(self, times: Series) -> Any:
        """Everything known beforehand at each tick time [s]; one leading axis."""

    @abstractmethod
    def init(self, state: GliderState) -> Any:
        """The reference's state before the first tick."""

    @abstractmethod
    def step(
        self, state: Any, planned: Any, measurement: Measurement, dt: Scalar
    ) -> tuple[Reference, Any]:
        """The reference of this tick, and the next state.

        Args:
            state: state from `init` or from the previous step.
            planned: row of `plan` for this tick.
            measurement: everything that is known of the glider.
            dt: tick [s].
        """


def clipped_angle_of_attack(state: GliderState) -> Scalar:
    """α = w/u [rad], with u kept above 0.02 m/s and α within ±0.3.

    θ_d = ξ_d + α; its rate is neglected.
    """
    return jnp.clip(state.heave / jnp.maximum(state.surge, 0.02), -0.3, 0.3)
