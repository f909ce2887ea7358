"""Protocol of a controller: its gains, a state, and one pure step.

A controller never sees the plant. It gets a measurement and asks its own design model
for f, g and h. All three laws of the paper differ only in the output acceleration they
demand; `allocate` turns that into a command, by the law's `steering`.
"""

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.prescribed.funnel import Funnel, Limits
from jaxglider.control.prescribed.performance import Bound, unbounded
from jaxglider.control.steering import INVERSION, AbstractSteering
from jaxglider.core.containers import Container, Scalar
from jaxglider.core.rotations import wrap
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    output_rates,
)
from jaxglider.vehicle.design_model import DesignModel


class ControlRecord(eqx.Module):
    """Report of a controller about one tick; the same type for every controller.

    Attributes:
        error: e = η − η_d [m, rad], angles wrapped to [−π, π).
        surface: the sliding variable of each channel.
    """

    error: Channels[Scalar]
    surface: Channels[Scalar]


class AbstractController(Container):
    """A control law. Its array fields are its gains: what is tuned.

    Every law has a `model`, the designer's belief of the glider, and a `funnel`, which
    its errors are judged by; either may be None.
    """

    if TYPE_CHECKING:
        # Fields or properties; a type checker would take the others for fields.
        @property
        def model(self) -> DesignModel | None:
            """The designer's belief of the glider."""

        @property
        def funnel(self) -> Funnel | None:
            """The funnel that its errors are judged by."""

    else:
        model: eqx.AbstractVar[DesignModel | None]
        funnel: eqx.AbstractVar[Funnel | None]

    @abstractmethod
    def init(self) -> Any:
        """The controller's state before the first tick."""

    @abstractmethod
    def step(
        self,
        state: Any,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], Any, ControlRecord]:
        """One tick.

        Args:
            state: state from `init` or from the previous step.
            measurement: everything that may be known of the glider.
            reference: wanted outputs with their rates.
            bounds: result of this controller's `bounds` at the reference's clock; an
                argument because it can often be computed for all ticks at once.
            dt: tick [s].

        Returns:
            The wanted command, the next state, and what is merely reported.
        """

    def on_board(self) -> "AbstractController":
        """The law as it runs on board; one with work to do beforehand has it done."""
        return self

    def paced(self, tick: Scalar) -> "AbstractController":
        """The law for a control tick [s]: itself, unless its design depends on it."""
        return self

    def cycle_time(self) -> Scalar:
        """Time from one run of the law to the next [s]; 0 for one of every tick."""
        return jnp.zeros(())

    def bounds(self, clock: Scalar) -> Channels[Bound]:
        """P, P', P'' of the funnel at t* [s]; infinite without one."""
        if self.funnel is None:
            return Channels(*(unbounded(clock),) * 3)
        return self.funnel.bounds(clock)

    def limits(self, bounds: Channels[Bound]) -> Channels[Limits]:
        """The edges within which the errors should stay, −δ_L P and δ_R P."""
        if self.funnel is None:
            return map_fields(lambda b: Limits(-b.value, b.value), bounds)
        return self.funnel.limits(bounds)


def tracking_error(
    measurement: Measurement, reference: Reference
) -> tuple[Channels[Scalar], Channels[Scalar]]:
    """e = η − η_d and e' = η' − η_d'; errors of angles are wrapped to [−π, π).

    So one attitude gives one command, however many full turns its angles hold. A law
    that uses an angle itself, not its sine, has to wrap it too.

    Args:
        measurement: measurement, or the truth in its form.
        reference: wanted outputs [m, rad] and their rates [m/s, rad/s].
    """
    s, target = measurement.state, reference.position
    error = Channels(
        s.depth - target.depth,
        wrap(s.pitch - target.pitch),
        wrap(s.heading - target.heading),
    )
    rate = map_fields(lambda a, b: a - b, output_rates(measurement), reference.rate)
    return error, rate


def allocate(
    model: DesignModel,
    measurement: Measurement,
    demand: Channels[Scalar],
    damping: Command[Scalar],
    steering: AbstractSteering = INVERSION,
) -> Command[Scalar]:
    """The command for the output acceleration that a law asks for.

    Where a plan has ordered the ballast, pitch and heading alone are solved for.

    Args:
        model: design model.
        measurement: measurement, which carries d̂.
        demand: wanted output acceleration η'' [m/s², rad/s²].
        damping: terms added to the diagonal of gᵀg, one positive number per actuator.
        steering: way to steer; the paper's inversion of g by default.
    """
    return steering.command(model, measurement, demand, damping)


def steered_error(
    steering: AbstractSteering,
    model: DesignModel,
    measurement: Measurement,
    reference: Reference,
) -> tuple[Channels[Scalar], Channels[Scalar]]:
    """e and e' as `tracking_error`, the heading rate as the steering has it.

    Args:
        steering: way to steer.
        model: design model.
        measurement: everything that may be known of the glider.
        reference: wanted outputs [m, rad] and their rates [m/s, rad/s].
    """
    error, rate = tracking_error(measurement, reference)
    return error, steering.error_rate(model, measurement, reference, rate)


def default_damping() -> Command[Scalar]:
    """1e-4 for each actuator."""
    return Command(*(jnp.asarray(1e-4, jnp.result_type(float)),) * 3)
