"""The study of Yang and Mahmoudian: its two cases, its gains and its printed tables.

Where the paper is silent: the second case starts at (0, 3) m ("off the path"), its
first leg begins at the origin, its horizon is 1200 s, and the gliding angles, given
until 800 s, go on with the same period. The depth gains break the paper's own rule
k₁ < ¾ k₂² (0.001 against 7.5e-5); they are kept as printed.
"""

import math
from typing import Any

from jaxglider.control.steering import AbstractSteering
from jaxglider.core.containers import choose
from jaxglider.environment.disturbances import Sinusoid, axes
from jaxglider.guidance import (
    AbstractReference,
    AttitudeSchedule,
    LineOfSight,
    Schedule,
    WaypointPath,
)
from jaxglider.paper.laws import SCENARIOS, funnel, make_law
from jaxglider.signals import GliderState
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Clock, Scenario
from jaxglider.simulation.specification import BANK_LIMIT, Specification
from jaxglider.vehicle.actuators import make_actuators
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.plant import AbstractPlant
from jaxglider.vehicle.plants import PLANTS
from jaxglider.vehicle.published import load_vehicle

DESIGN_FACTOR = 0.8
"""The "20 % uncertainty": design parameters over true ones."""

VEHICLE = "seawing"
"""Name of the glider that flies the cases."""
DURATION = {"switching": 800.0, "waypoints": 1200.0}
"""Horizon of each case [s]."""
_SHALLOW, _STEEP = -math.pi / 4, -math.pi / 3


def attitude_schedule() -> Schedule:
    """Gliding angles, headings and depth rate of the first case."""
    return Schedule(
        start=[0.0, 200.0, 400.0, 600.0],
        gliding_angle=[_SHALLOW, _STEEP] * 2,
        heading=[math.pi / 6, 0.0, -math.pi / 6, math.pi / 10],
        depth_rate=[0.1] * 4,
    )


def vertical_schedule() -> Schedule:
    """Gliding angles and depth rate of the second case, the first's repeated."""
    return Schedule(
        start=[0.0, 200.0, 400.0, 600.0, 800.0, 1000.0],
        gliding_angle=[_SHALLOW, _STEEP] * 3,
        heading=[0.0] * 6,
        depth_rate=[0.1] * 6,
    )


def reference(scenario: str) -> AbstractReference:
    """The task of a case: `switching` or `waypoints`."""
    if scenario == "switching":
        return AttitudeSchedule(attitude_schedule())
    return WaypointPath(
        north=[10.0, 15.0, 30.0, 50.0, 50.0],
        east=[5.0, -10.0, -15.0, -5.0, 10.0],
        line_of_sight=guidance(),
        vertical=vertical_schedule(),
        radius=5.0,
    )


def guidance() -> LineOfSight:
    """Guidance gains of the second case."""
    return LineOfSight(2.5, 0.01)


def disturbance() -> Sinusoid:
    """The sinusoidal environment of both cases."""
    slow, slower = math.pi / 100, 2 * math.pi / 300
    return Sinusoid(
        amplitude=axes(0.02, 0.01, -0.02, 0.01, 0.02, -0.01),
        frequency=axes(slow, slow, slower, slow, slow, slow),
        phase=axes(),
    )


def specification(scenario: str, plant: AbstractPlant) -> Specification:
    """The specification of a case: the paper's performance functions, and a bank limit.

    The paper has no limit on the roll; 45 degrees are ours, for every plant but the
    printed one, whose roll is not that of a glider.

    Args:
        scenario: `switching` or `waypoints`.
        plant: glider that is flown.
    """
    limit = BANK_LIMIT if plant.consistent else None
    return Specification(funnel(scenario), largest_roll=limit)


def make_scenario(
    scenario: str = "switching",
    plant: str = "printed",
    *,
    vehicle: str = VEHICLE,
    dt: float = 0.05,
    substeps: int = 1,
    duration: float | None = None,
    actuators: str | None = None,
) -> Scenario:
    """One of the paper's cases on one of the plants.

    Args:
        scenario: `switching` or `waypoints`.
        plant: `printed`, `rigid-body` or `seawing`.
        vehicle: name or path of the vehicle's data.
        dt: control tick [s].
        substeps: integration steps per tick.
        duration: horizon [s]; the case's own by default.
        actuators: `vehicle` for the rates of the vehicle's file, `ideal` for none, as
            in the paper; by default `ideal` on `printed` and `vehicle` elsewhere.

    Raises:
        ValueError: an unknown name.
    """
    choose("scenario", scenario, SCENARIOS)
    choose("plant", plant, tuple(PLANTS))
    data = load_vehicle(vehicle)
    glider = PLANTS[plant](data)
    start = GliderState.at_rest(east=3.0 if scenario == "waypoints" else 0.0)
    return Scenario(
        clock=Clock.lasting(
            DURATION[scenario] if duration is None else duration, dt, substeps
        ),
        plant=glider,
        actuators=make_actuators(data, actuators or default_actuators(plant)),
        disturbance=disturbance(),
        reference=reference(scenario),
        initial_state=start,
        specification=specification(scenario, glider),
    )


def default_actuators(plant: str) -> str:
    """The kind of actuators that a plant has where nothing is said.

    Args:
        plant: name of the plant; the printed one is the paper's, whose actuators jump.
    """
    return "ideal" if plant == "printed" else "vehicle"


def design_model(plant: AbstractPlant, factor: float = DESIGN_FACTOR) -> DesignModel:
    """The design model that the paper's designer has of a plant.

    Args:
        plant: glider to be steered.
        factor: factor on all its parameters in the belief.
    """
    exact = plant.model()
    return DesignModel(exact.parameters.scaled(factor), exact.actuation)


def make_loop(
    scenario: str = "switching",
    plant: str = "printed",
    controller: str = "fxtppc",
    *,
    steering: AbstractSteering | None = None,
    **options: Any,
) -> ClosedLoop:
    """A whole closed loop of the paper.

    Args:
        scenario: `switching` or `waypoints`.
        plant: name of the plant, one of `PLANTS`.
        controller: name of the controller.
        steering: way to steer; `default_steering` by default.
        options: further arguments of `make_scenario`.

    Raises:
        ValueError: a name is unknown.
    """
    setting = make_scenario(scenario, plant, **options)
    model = design_model(setting.plant)
    return make_law(controller, scenario, model, steering).on(setting)
