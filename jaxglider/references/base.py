"""What every reference is, and the attitude schedule that all of them build on."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider._types import Container, Scalar, Series, as_float, concrete
from jaxglider.signals import GliderState, Measurement, Reference


class AbstractReference(Container):
    """Tells the glider what to do.

    What depends on time alone is planned for all ticks at once; the rest is stepped.

    Attributes:
        scheduled: the funnel's clock is known beforehand (`plan` carries `clock`), so
            performance functions can be computed for all ticks at once.
        can_finish: the mission can end before the horizon.
    """

    scheduled: eqx.AbstractClassVar[bool]
    can_finish: eqx.AbstractClassVar[bool]

    @property
    def waypoints(self) -> int | None:
        """How many waypoints there are to reach; None where there is no course."""
        return None

    @abstractmethod
    def plan(self, times: Series) -> Any:
        """What is known beforehand at each tick time [s]; one leading axis."""

    @abstractmethod
    def init(self, state: GliderState) -> Any:
        """The reference's state before the first tick."""

    @abstractmethod
    def step(
        self, state: Any, planned: Any, measurement: Measurement, dt: Scalar
    ) -> tuple[Reference, Any]:
        """What to do in this tick, and the reference's next state.

        Args:
            state: from `init` or the previous step.
            planned: this tick's share of `plan`.
            measurement: what is known of the glider.
            dt: tick [s].
        """


class Segment(eqx.Module):
    """A schedule at one instant.

    Attributes:
        number: of the segment.
        clock: time since it began [s].
        depth: wanted depth [m].
        depth_rate: its rate [m/s].
        gliding_angle: ξ_d [rad], negative down.
        heading: ψ_d [rad].
    """

    number: jax.Array
    clock: Scalar
    depth: Scalar
    depth_rate: Scalar
    gliding_angle: Scalar
    heading: Scalar


class Schedule(Container):
    """Piecewise constant gliding angle, heading and depth rate.

    Attributes:
        start: when each segment begins [s]; the first at 0, increasing. The last goes
            on for ever.
        gliding_angle: ξ_d of each [rad], negative down.
        heading: ψ_d of each [rad].
        depth_rate: of each [m/s], positive down.
        initial_depth: wanted depth at time 0 [m].

    Raises:
        ValueError: lengths differ, there is no segment, or the starts do not begin at
            zero and increase.
    """

    start: Series = eqx.field(converter=as_float)
    gliding_angle: Series = eqx.field(converter=as_float)
    heading: Series = eqx.field(converter=as_float)
    depth_rate: Series = eqx.field(converter=as_float)
    initial_depth: Scalar = eqx.field(converter=as_float, default=0.0)

    def __check_init__(self) -> None:
        lengths = {
            name: np.shape(getattr(self, name))
            for name in ("start", "gliding_angle", "heading", "depth_rate")
        }
        if len(set(lengths.values())) != 1 or any(
            len(s) != 1 or s[0] == 0 for s in lengths.values()
        ):
            raise ValueError(
                "Schedule needs start, gliding_angle, heading and depth_rate of one "
                f"length, at least 1; received shapes {lengths}."
            )
        start = concrete(self.start)
        if start is not None and (start[0] != 0.0 or np.any(np.diff(start) <= 0.0)):
            raise ValueError(
                "Schedule.start must begin at 0 and increase; "
                f"received {start.tolist()}."
            )

    def at(self, time: Scalar) -> Segment:
        """The schedule at one time [s]."""
        number = jnp.searchsorted(self.start, time, side="right") - 1
        clock = time - self.start[number]
        lasted = jnp.diff(self.start, append=self.start[-1:])
        reached = self.initial_depth + jnp.cumsum(self.depth_rate * lasted)
        begun = jnp.concatenate([self.initial_depth[None], reached[:-1]])
        rate = self.depth_rate[number]
        return Segment(
            number,
            clock,
            begun[number] + rate * clock,
            rate,
            self.gliding_angle[number],
            self.heading[number],
        )


def angle_of_attack(state: GliderState) -> Scalar:
    """α = w/u [rad], with u kept above 0.02 m/s and α within ±0.3.

    θ_d = ξ_d + α; its rate is neglected.
    """
    return jnp.clip(state.heave / jnp.maximum(state.surge, 0.02), -0.3, 0.3)
