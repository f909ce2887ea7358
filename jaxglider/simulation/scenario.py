"""Scenario: everything of a run but its controller."""

import dataclasses
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
from jaxglider.environment.seabed import Seabed
from jaxglider.environment.tables import SeabedGrid
from jaxglider.environment.water import Water, relative_to_water
from jaxglider.guidance.reference import AbstractReference
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.navigation.navigator import Navigator
from jaxglider.navigation.reckoning import Reckoning
from jaxglider.navigation.sensing.readings import Instruments, Sampled
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.simulation.origin import MAP_ZERO, Origin
from jaxglider.simulation.resolution import check_resolution
from jaxglider.simulation.specification import Specification
from jaxglider.vehicle.actuators import Actuator
from jaxglider.vehicle.energy import Consumers, EnergyModel
from jaxglider.vehicle.plant import AbstractPlant
from jaxglider.vehicle.sensors import Sensor, check_sensors, realise_errors

SensorErrors = dict[str, Series] | Sampled
"""Errors of the sensors by state, or the samples of instruments, at every tick."""
MAX_TICKS = 1e8
"""More ticks than this would not fit in memory."""


class Clock(Container):
    """The control tick and how long a run lasts.

    Attributes:
        ticks: number of control ticks.
        dt: control tick [s].
        substeps: integration steps per tick.
        moving: flag, the actuators move on from integration step to step; without it
            they take their place for the whole tick at its start, which suits ticks
            that are short beside their moves.

    Raises:
        ValueError: a count below one, or a tick that is not positive.
    """

    ticks: int = eqx.field(static=True)
    dt: Scalar = eqx.field(converter=as_float, default=0.05)
    substeps: int = eqx.field(static=True, default=1)
    moving: bool = eqx.field(static=True, default=False)

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

    @classmethod
    def sampled(cls, duration: float, period: float, step: float) -> "Clock":
        """A clock for a law that runs once in a period of many integration steps.

        The command is held over the period, the actuators move in every step.

        Args:
            duration: length of the run [s], rounded up to whole periods.
            period: control period [s].
            step: longest integration step [s]; shortened to fit the period.

        Raises:
            ValueError: a number is not positive, or the run has too many ticks.
        """
        check_interval("Clock", "step", step, 0.0, period, closed_high=True)
        clock = cls.lasting(duration, period, math.ceil(period / step - 1e-6))
        return dataclasses.replace(clock, moving=True)

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
        instruments: sensors on board, for a glider that knows no more than they show;
            None for one that is told its state, with the errors of `sensors`.
        reckoning: dead reckoning with instruments; that of the plant by default.
        specification: bounds prescribed, whoever steers; None to judge errors by the
            law's own funnel, which a law could widen, and nothing else.
        water: currents and density, or None for water at rest, the same at every depth.
        seabed: bottom of the sea, or None for a sea without one.
        energy: consumption of the glider, or None where nobody counts it.
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
    seabed: Seabed | SeabedGrid | None = None
    energy: EnergyModel | None = None
    origin: Origin = eqx.field(static=True, default=MAP_ZERO)
    instruments: Instruments | None = None
    reckoning: Reckoning | None = None

    def __check_init__(self) -> None:
        check_sensors(self.sensors)
        check_resolution(self)

    @property
    def measures_flight(self) -> bool:
        """Whether energy, yos and moves are counted."""
        return self.reference.phased or self.energy is not None

    def altitude(self, state: GliderState) -> Scalar | None:
        """Height over the bottom [m], or None without one."""
        return None if self.seabed is None else self.seabed.altitude(state)

    def through_water(
        self, state: GliderState, time: Scalar
    ) -> tuple[GliderState, tuple[Scalar, Scalar] | None]:
        """The state with its velocity through the water; and the current, or None.

        Args:
            state: state over ground.
            time: present time [s].
        """
        return relative_to_water(self.water, state, time)

    def charge(self, spent: Consumers | None) -> Scalar | None:
        """Energy left in the battery [J], or None where nothing counts it."""
        if spent is None or self.energy is None or self.energy.battery is None:
            return None
        return self.energy.battery - spent.total()

    def navigator(self, estimator: AbstractEstimator | None) -> Navigator | None:
        """Sensors, estimator and reckoning; None without instruments.

        Args:
            estimator: estimator of the closed loop, or None.

        Raises:
            ValueError: there are instruments, and no estimator.
        """
        if self.instruments is None:
            return None
        if estimator is None:
            raise ValueError(
                "a scenario with instruments needs an estimator; received none. Give "
                "the ClosedLoop one, such as jaxglider.ModelAided, or take the "
                "instruments away."
            )
        reckoning = self.reckoning
        if reckoning is None:
            reckoning = Reckoning(self.plant.parameters)
        return Navigator(self.instruments, estimator, reckoning)

    @jax.named_scope("disturbance")
    def sea(self, key: jax.Array) -> BodyAxes[Series]:
        """The disturbance realised at every tick [N, N m]; see `disturbances`."""
        return self.disturbance.realise(key, self.clock.times())

    @jax.named_scope("sensor_errors")
    def noise(self, key: jax.Array) -> SensorErrors | None:
        """The sensors' errors realised at every tick, or None without sensors."""
        times, errors = self.clock.times(), None
        if self.sensors is not None:
            errors = realise_errors(self.sensors, key, times)
        if self.instruments is None:
            return errors
        return Sampled(self.instruments.realise(key, times), errors)
