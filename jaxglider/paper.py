"""The study of Yang and Mahmoudian: its two cases, its gains and its printed tables.

Where the paper is silent: the second case starts at (0, 3) m ("off the path"), its
first leg begins at the origin, its horizon is 1200 s, and the gliding angles, given
until 800 s, go on with the same period. The depth gains break the paper's own rule
k₁ < ¾ k₂² (0.001 against 7.5e-5); they are kept as printed.
"""

import functools
import math
import tomllib
from collections.abc import Callable
from importlib import resources
from typing import Any

from jaxglider.controllers import (
    PPC,
    SMC,
    AbstractController,
    ChannelGains,
    Funnel,
    FxTPPC,
    RollAwareFxTPPC,
)
from jaxglider.controllers.fxtppc import paper_exponents
from jaxglider.disturbances import Sinusoid, axes
from jaxglider.observer import AbstractObserver, FixedTimeObserver, NoObserver
from jaxglider.performance import (
    AbstractPerformanceFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.references import (
    AbstractReference,
    AttitudeSchedule,
    LineOfSight,
    Schedule,
    WaypointPath,
)
from jaxglider.rollout import ClosedLoop
from jaxglider.scenario import Clock, Scenario
from jaxglider.signals import BodyAxes, Channels, GliderState, each
from jaxglider.transform import ErrorTransformation
from jaxglider.vehicle.actuators import Actuator
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.files import load_vehicle
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant, printed_plant, rigid_body_plant

DESIGN_FACTOR = 0.8
"""The "20 % uncertainty": design parameters over true ones."""

PLANTS: dict[str, Callable[[VehicleData], AbstractPlant]] = {
    "printed": lambda vehicle: printed_plant(vehicle.parameters),
    "rigid-body": lambda vehicle: rigid_body_plant(vehicle.parameters),
    "seawing": full_plant,
}
"""The paper's glider, the same with a consistent moving mass, and the published one."""
CONTROLLERS = ("smc", "ppc", "fxtppc")
ROLL_AWARE = "fxtppc-roll"
"""The third law made aware of the roll; not the paper's."""
DURATION = {"switching": 800.0, "waypoints": 1200.0}
SCENARIOS = tuple(DURATION)

_FUNNELS = {
    # scenario: channel: P_0, P_inf, T
    "switching": {
        "depth": (1.0, 0.2, 100.0),
        "pitch": (5 * math.pi / 18, math.pi / 18, 80.0),
        "heading": (5 * math.pi / 18, math.pi / 12, 100.0),
    },
    "waypoints": {
        "depth": (1.0, 0.5, 100.0),
        "pitch": (5 * math.pi / 18, math.pi / 18, 80.0),
        "heading": (5 * math.pi / 18, 2 * math.pi / 45, 60.0),
    },
}


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


def make_scenario(
    scenario: str = "switching",
    plant: str = "printed",
    *,
    vehicle: str = "seawing",
    dt: float = 0.05,
    substeps: int = 1,
    duration: float | None = None,
) -> Scenario:
    """One of the paper's cases on one of the plants.

    Args:
        scenario: `switching` or `waypoints`.
        plant: `printed`, `rigid-body` or `seawing`.
        vehicle: name or path of the vehicle's data.
        dt: control tick [s].
        substeps: integration steps per tick.
        duration: horizon [s]; the case's own by default.

    Raises:
        ValueError: an unknown name.
    """
    choose("scenario", scenario, SCENARIOS)
    choose("plant", plant, tuple(PLANTS))
    data = load_vehicle(vehicle)
    start = GliderState.at_rest(east=3.0 if scenario == "waypoints" else 0.0)
    return Scenario(
        Clock.lasting(
            DURATION[scenario] if duration is None else duration, dt, substeps
        ),
        PLANTS[plant](data),
        each(Actuator, data.limits),
        disturbance(),
        reference(scenario),
        start,
    )


def design_model(plant: AbstractPlant, factor: float = DESIGN_FACTOR) -> DesignModel:
    """What the paper's designer believes of a plant."""
    exact = plant.model()
    return DesignModel(exact.parameters.scaled(factor), exact.actuation)


def funnel(
    scenario: str, form: type[AbstractPerformanceFunction] = SechFunction
) -> Funnel:
    """The performance functions of a case, symmetric, in one of the forms."""
    performance = {
        channel: form(*numbers) for channel, numbers in _FUNNELS[scenario].items()
    }
    return Funnel(Channels(**performance), _on_each(ErrorTransformation()))


def make_controller(name: str, scenario: str, model: DesignModel) -> AbstractController:
    """One of the three controllers with the paper's gains, or `fxtppc-roll`.

    The funnel of `smc` only serves to judge it by the same bounds.

    Raises:
        ValueError: an unknown name.
    """
    choose("controller", name, (*CONTROLLERS, ROLL_AWARE))
    choose("scenario", scenario, SCENARIOS)
    if name == "smc":
        return SMC(
            model,
            c0=Channels(0.1, 0.1, 0.1),
            c1=Channels(1.0, 1.0, 1.0),
            c2=Channels(5.0, 5.0, 5.0),
            funnel=funnel(scenario),
        )
    if name == "ppc":
        return PPC(
            model,
            funnel(scenario, HalfSechFunction),
            l0=Channels(0.1, 0.1, 0.1),
            l1_margin=Channels(0.1, 0.1, 0.1),
            l2=Channels(1.0, 1.0, 3.0),
        )
    law = FxTPPC(
        model,
        funnel(scenario),
        Channels(
            ChannelGains(0.001, 0.01),
            ChannelGains(0.01, 0.2),
            ChannelGains(0.001, 0.08),
        ),
        exponents=paper_exponents,
    )
    return law if name == "fxtppc" else RollAwareFxTPPC(law)


def fixed_time_observer(model: DesignModel) -> FixedTimeObserver:
    """The observer with the paper's gains."""
    return FixedTimeObserver(
        model,
        proportional=BodyAxes(0.001, 0.001, 0.01, 0.01, 0.01, 0.01),
        integral=BodyAxes(0.01, 0.01, 0.1, 0.1, 0.1, 0.1),
        stretch=BodyAxes(18.0, 18.0, 18.0, 180.0, 180.0, 180.0),
    )


def make_observer(controller: str, model: DesignModel) -> AbstractObserver:
    """The observer the paper gives a controller: none for `smc`."""
    return NoObserver() if controller == "smc" else fixed_time_observer(model)


def make_loop(
    scenario: str = "switching",
    plant: str = "printed",
    controller: str = "fxtppc",
    **options: Any,
) -> ClosedLoop:
    """A whole closed loop of the paper; options as for `make_scenario`."""
    setting = make_scenario(scenario, plant, **options)
    model = design_model(setting.plant)
    return ClosedLoop(
        setting,
        make_controller(controller, scenario, model),
        make_observer(controller, model),
    )


def choose(argument: str, value: str, allowed: tuple[str, ...]) -> None:
    """Refuse a name that is not one of those allowed.

    Raises:
        ValueError: names the argument and the choices.
    """
    if value not in allowed:
        raise ValueError(
            f"{argument} must be one of {', '.join(allowed)}; received {value!r}."
        )


def _on_each(thing: Any) -> Channels[Any]:
    return Channels(thing, thing, thing)


@functools.cache
def printed_tables() -> dict[str, Any]:
    """The paper's two tables: scenario, channel, row, then a list over `columns`."""
    return tomllib.loads(
        (resources.files("jaxglider") / "paper_tables.toml").read_text()
    )


def printed_value(
    scenario: str, channel: str, controller: str, row: str
) -> float | None:
    """One number of the printed tables, or None where they have none.

    Args:
        scenario: `switching` or `waypoints`.
        channel: `depth`, `pitch` or `heading`.
        controller: `smc`, `ppc` or `fxtppc`.
        row: `transient`, `average_tracking`, `average_effort` or `chattering`.
    """
    tables = printed_tables()
    if scenario not in tables or controller not in tables["columns"]:
        return None
    column = tables["columns"].index(controller)
    return float(tables[scenario][channel][row][column])
