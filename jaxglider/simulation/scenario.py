"""Scenario: everything of a run but its controller."""

import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import (
    Container,
    Scalar,
    Series,
    as_float,
    check_interval,
)
from jaxglider.environment.disturbances import AbstractDisturbance
from jaxglider.environment.water import Water
from jaxglider.guidance.reference import AbstractReference
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.simulation.origin import MAP_ZERO, Origin
from jaxglider.simulation.resolution import check_resolution
from jaxglider.simulation.specification import Specification
from jaxglider.vehicle.actuators import Actuator
from jaxglider.vehicle.plant import AbstractPlant
from jaxglider.vehicle.sensors import Sensor, check_sensors, realise_errors

MAX_TICKS = 1e8
"""More ticks than this would not fit in memory."""


class Clock(Container):
    """The control tick and how long a run lasts.

    Attributes:
        ticks: number of control ticks.
        dt: control tick [s].
        substeps: integration steps per tick.

    Raises:
        ValueError: a count below one, or a tick that is not positive.
    """

    ticks: int = eqx.field(static=True)
    dt: Scalar = eqx.field(converter=as_float, default=0.05)
    substeps: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        check_interval("Clock", "ticks", self.ticks, 1.0, closed_low=True)
        check_interval("Clock", "dt", self.dt, 0.0)
        check_interval("Clock", "substeps", self.substeps, 1.0, closed_low=True)

    @classmethod
    def lasting(cls, duration: float, dt: float = 0.05, substeps: int = 1) -> "Clock":
        """A clock for a duration [s], a whole number of ticks (rounded up).

        Args:
            duration: length of the run [s].
            dt: control tick [s].
            substeps: integration steps per tick.

        Raises:
            ValueError: a number is not positive, or the run has too many ticks.
        """
        check_interval("Clock", "duration", duration, 0.0)
        check_interval("Clock", "dt", dt, 0.0, duration, closed_high=True)
        check_interval(
            "Clock",
            "ticks",
            duration / dt,
            high=MAX_TICKS,
            closed_high=True,
            remedy="Shorten the run or lengthen the tick.",
        )
        return cls(math.ceil(duration / dt - 1e-6), dt, substeps)

    def times(self) -> Series:
        """Tick times from 0 to the end of the last tick [s]."""
        return jnp.arange(self.ticks + 1, dtype=self.dt.dtype) * self.dt


class Scenario(Container):
    """One vehicle, one sea, one task.

    Attributes:
        clock: tick and horizon.
        plant: the true glider.
        actuators: the true actuators.
        disturbance: external forces of the sea.
        reference: the task.
        initial_state: state of the glider at time zero.
        sensors: errors of the measurement by the name of the state, or None for none.
        specification: bounds prescribed, whoever steers; None to judge errors by the
            law's own funnel, which a law could widen, and nothing else.
        water: currents and density, or None for water at rest, the same at every depth.
        origin: place that positions count from; static, since no program uses it.

    Raises:
        ValueError: a sensor is named after no state, or single precision is too coarse
            for its positions or times.
    """

    clock: Clock
    plant: AbstractPlant
    actuators: Command[Actuator]
    disturbance: AbstractDisturbance
    reference: AbstractReference
    initial_state: GliderState
    sensors: Mapping[str, Sensor] | None = None
    specification: Specification | None = None
    water: Water | None = None
    origin: Origin = eqx.field(static=True, default=MAP_ZERO)

    def __check_init__(self) -> None:
        check_sensors(self.sensors)
        check_resolution(self)

    @jax.named_scope("disturbance")
    def sea(self, key: jax.Array) -> BodyAxes[Series]:
        """The disturbance realised at every tick [N, N m]; see `disturbances`."""
        return self.disturbance.realise(key, self.clock.times())

    @jax.named_scope("sensor_errors")
    def noise(self, key: jax.Array) -> dict[str, Series] | None:
        """The sensors' errors realised at every tick, or None without sensors."""
        if self.sensors is None:
            return None
        return realise_errors(self.sensors, key, self.clock.times())
