"""A user's own mission as TOML: vehicle, sea, task, controller, clock.

Every key carries its unit. What is left out takes the value of the paper's first case.
`TEMPLATE` is a complete, commented file.
"""

import dataclasses
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider import paper
from jaxglider._mission import (
    read_actuators,
    read_clock,
    read_disturbance,
    read_initial_state,
    read_reference,
    read_vehicle,
    read_water,
)
from jaxglider._toml import (
    ConfigError,
    Table,
    choice,
    read_toml,
)
from jaxglider._types import Scalar
from jaxglider._uncertainty import load_uncertainty as load_uncertainty
from jaxglider.controllers import tracking_error
from jaxglider.controllers.base import Limits
from jaxglider.gains import decode
from jaxglider.rollout import ClosedLoop
from jaxglider.scenario import Scenario
from jaxglider.signals import Channels, Measurement

TEMPLATE = (resources.files("jaxglider") / "mission.toml").read_text
"""Call it for the text of a complete, commented mission file."""

SEEDS = 2**32
"""Seeds are below this: what a key of JAX takes in either precision."""


@dataclasses.dataclass(frozen=True)
class Mission:
    """What a mission file asks for.

    Attributes:
        name: of the mission.
        loop: the closed loop.
        seed: of the sea.
        controller: name of its kind.
        plant: name of its kind.
    """

    name: str
    loop: ClosedLoop
    seed: int
    controller: str
    plant: str


def load_mission(path: str | Path) -> Mission:
    """Read a mission file.

    Relative paths in it are relative to its folder.

    Raises:
        ConfigError: names the file, the key, the rule and the value.
    """
    folder = Path(path).parent
    try:
        return build_mission(read_toml(path), folder)
    except ConfigError as error:
        text = str(error)
        raise ConfigError(
            text if text.startswith(f"{path}: ") else f"{path}: {text}"
        ) from error


def build_mission(data: dict[str, Any], folder: Path = Path()) -> Mission:
    """A mission from parsed TOML.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = Table(data, "")
    name, seed = top.text("name", "mission"), top.whole("seed", 0)
    if not 0 <= seed < SEEDS:
        raise ConfigError(f"seed must be in [0, {SEEDS}); received {seed}.")
    vehicle_table = top.table("vehicle")
    vehicle = read_vehicle(vehicle_table, folder)
    plant_name = vehicle_table.text("plant", "printed")
    make_plant = choice(plant_name, paper.PLANTS, "vehicle.plant")
    factor = vehicle_table.number("design_factor", paper.DESIGN_FACTOR)
    vehicle_table.close()
    try:
        plant = make_plant(vehicle)
    except ValueError as error:
        raise ConfigError(f"vehicle.plant: {error}") from error
    scenario = Scenario(
        read_clock(top.table("clock")),
        plant,
        read_actuators(top.table("actuators"), vehicle.limits),
        read_disturbance(top.tables("disturbance")),
        read_reference(top.table("reference")),
        read_initial_state(top.table("initial_state")),
        water=read_water(top.table("water"), vehicle),
    )
    if factor <= 0.0:
        raise ConfigError(f"vehicle.design_factor must be positive; received {factor}.")
    model = paper.design_model(plant, factor)
    kind, controller, observer = _controller(
        top.table("controller"), model, scenario, folder
    )
    table = top.table("observer")
    observer = decode_observer(table.rest(), kind, model, observer)
    top.close()
    loop = ClosedLoop(scenario, controller, observer)
    return Mission(name, loop, seed, kind, plant_name)


def decode_observer(table: Any, controller: str, model: Any, given: Any = None) -> Any:
    """The observer a table asks for.

    Args:
        table: what the file says of it.
        controller: kind of the controller.
        model: design model.
        given: what the table overrides; the paper's for its controller by default.
    """
    if given is None:
        given = paper.make_observer(controller, model)
    if isinstance(table, dict) and "type" in table:
        allowed = {"none": "smc", "fixed-time": "fxtppc"}
        wanted = paper.make_observer(
            choice(table["type"], allowed, "observer.type"), model
        )
        given = given if type(given) is type(wanted) else wanted
    return decode(given, table, "observer")


def load_gains(path: str | Path, scenario: str, model: Any) -> tuple[str, Any, Any]:
    """A gains file: the kind of controller, the controller and its observer.

    Args:
        path: of the file, as `jaxglider tune` writes it.
        scenario: `switching` or `waypoints`, for what the file leaves out.
        model: design model.

    Raises:
        ConfigError: names the file, the key, the rule and the value.
    """
    data = read_toml(path)
    try:
        return decode_gains(data, scenario, model)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def decode_gains(
    data: dict[str, Any], scenario: str, model: Any
) -> tuple[str, Any, Any]:
    """Parsed gains: the kind of controller, the controller and its observer.

    Args:
        data: tables of a gains file.
        scenario: `switching` or `waypoints`, for what they leave out.
        model: design model.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = Table(data, "")
    table = top.get("controller")
    kind = Table(table, "controller").text("type")
    choice(kind, dict.fromkeys(paper.CONTROLLERS), "controller.type")
    controller = decode(
        paper.make_controller(kind, scenario, model), table, "controller"
    )
    observer = decode_observer(top.get("observer", {}), kind, model)
    top.get("provenance", None)
    choice(str(top.get("format", 1)), {"1": 1}, "format")
    top.close()
    return kind, controller, observer


def start_warnings(loop: ClosedLoop) -> list[str]:
    """What is odd about the start: channels whose error begins outside the funnel."""
    error, limits = jax.jit(_start)(loop)
    found = []
    for channel in ("depth", "pitch", "heading"):
        e, edge = getattr(error, channel), getattr(limits, channel)
        if not bool((e > edge.lower) & (e < edge.upper)):
            found.append(
                f"the {channel} error starts at {float(e):.4g}, outside its funnel "
                f"({float(edge.lower):.4g}, {float(edge.upper):.4g}): the run goes on, "
                "but the prescribed performance is not guaranteed."
            )
    return found


def _start(loop: ClosedLoop) -> tuple[Channels[Scalar], Channels[Limits]]:
    """Error and edges of the funnel in the first tick."""
    scenario = loop.scenario
    state = scenario.initial_state
    planned = scenario.reference.plan(jnp.zeros_like(scenario.clock.dt)[None])
    carry = loop.init()
    measurement = Measurement(
        state, state.attitude(), carry.held, loop.observer.estimate(carry.observer)
    )
    first = jax.tree.map(lambda x: x[0], planned)
    reference, _ = scenario.reference.step(
        carry.reference, first, measurement, scenario.clock.dt
    )
    error, _ = tracking_error(measurement, reference)
    return error, loop.controller.limits(loop.controller.bounds(reference.clock))


def _controller(
    table: Table, model: Any, scenario: Scenario, folder: Path
) -> tuple[str, Any, Any]:
    """Kind, controller, and the observer of its gains file, if there is one."""
    case = "waypoints" if scenario.reference.can_finish else "switching"
    source = table.get("gains_file", None)
    observer = None
    if source is not None:
        file = folder / table.text("gains_file")
        kind, controller, observer = load_gains(file, case, model)
        if table.text("type", kind) != kind:
            raise ConfigError(
                f"controller.type must be {kind!r}, the kind that {file} holds; "
                f"received {table.text('type')!r}. Change one of the two."
            )
    else:
        kind = table.text("type", "fxtppc")
        choice(kind, dict.fromkeys(paper.CONTROLLERS), "controller.type")
        controller = paper.make_controller(kind, case, model)
    return kind, decode(controller, table.rest(), "controller"), observer
