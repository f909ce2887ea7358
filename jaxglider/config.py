"""A user's own mission as TOML: vehicle, sea, task, controller, clock.

Every key carries its unit. What is left out takes the value of the paper's first case.
`TEMPLATE` is a complete, commented file.
"""

import dataclasses
from importlib import resources
from pathlib import Path
from typing import Any

import jax

from jaxglider import paper
from jaxglider._mission import (
    read_actuators,
    read_clock,
    read_disturbance,
    read_initial_state,
    read_reference,
    read_vehicle,
)
from jaxglider._toml import (
    ConfigError,
    Table,
    choice,
    read_toml,
)
from jaxglider.controllers import tracking_error
from jaxglider.gains import decode
from jaxglider.rollout import ClosedLoop
from jaxglider.scenario import Scenario
from jaxglider.signals import Measurement

TEMPLATE = (resources.files("jaxglider") / "mission.toml").read_text
"""Call it for the text of a complete, commented mission file."""


@dataclasses.dataclass(frozen=True)
class Mission:
    """What a mission file asks for.

    Attributes:
        name: of the mission.
        loop: the closed loop.
        seed: of the sea.
        controller: name of its kind.
    """

    name: str
    loop: ClosedLoop
    seed: int
    controller: str


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
            text if text.startswith(str(path)) else f"{path}: {text}"
        ) from (error)


def build_mission(data: dict[str, Any], folder: Path = Path()) -> Mission:
    """A mission from parsed TOML.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = Table(data, "")
    name, seed = top.text("name", "mission"), top.whole("seed", 0)
    vehicle_table = top.table("vehicle")
    vehicle = read_vehicle(vehicle_table, folder)
    make_plant = choice(
        vehicle_table.text("plant", "printed"), paper.PLANTS, "vehicle.plant"
    )
    factor = vehicle_table.number("design_factor", paper.DESIGN_FACTOR)
    vehicle_table.close()
    plant = make_plant(vehicle.parameters)
    scenario = Scenario(
        read_clock(top.table("clock")),
        plant,
        read_actuators(top.table("actuators"), vehicle.limits),
        read_disturbance(top.tables("disturbance")),
        read_reference(top.table("reference")),
        read_initial_state(top.table("initial_state")),
    )
    if factor <= 0.0:
        raise ConfigError(f"vehicle.design_factor must be positive; received {factor}.")
    model = paper.design_model(plant, factor)
    kind, controller = _controller(top.table("controller"), model, scenario, folder)
    table = top.table("observer")
    observer = decode_observer(table.rest(), kind, model)
    top.close()
    return Mission(name, ClosedLoop(scenario, controller, observer), seed, kind)


def decode_observer(table: dict[str, Any], controller: str, model: Any) -> Any:
    """The observer a table asks for; the paper's for its controller by default."""
    default = "none" if controller == "smc" else "fixed-time"
    kind = choice(
        table.get("type", default), {"none": 0, "fixed-time": 1}, "observer.type"
    )
    template = paper.make_observer("fxtppc" if kind else "smc", model)
    return decode(template, table, "observer")


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
        top = Table(data, "")
        table = top.get("controller")
        kind = Table(table, "controller").text("type")
        choice(kind, dict.fromkeys(paper.CONTROLLERS), "controller.type")
        controller = decode(
            paper.make_controller(kind, scenario, model), table, "controller"
        )
        observer = decode_observer(top.get("observer", {}), kind, model)
        for key in ("provenance", "format"):
            top.get(key, None)
        top.close()
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return kind, controller, observer


def start_warnings(loop: ClosedLoop) -> list[str]:
    """What is odd about the start: channels whose error begins outside the funnel."""
    scenario = loop.scenario
    state = scenario.initial_state
    planned = scenario.reference.plan(scenario.clock.times()[:1])
    carry = loop.init()
    measurement = Measurement(
        state, state.attitude(), carry.held, loop.observer.estimate(carry.observer)
    )
    first = jax.tree.map(lambda x: x[0], planned)
    reference, _ = scenario.reference.step(
        carry.reference, first, measurement, scenario.clock.dt
    )
    error, _ = tracking_error(measurement, reference)
    limits = loop.controller.limits(loop.controller.bounds(reference.clock))
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


def _controller(
    table: Table, model: Any, scenario: Scenario, folder: Path
) -> tuple[str, Any]:
    case = "waypoints" if scenario.reference.can_finish else "switching"
    source = table.get("gains_file", None)
    if source is not None:
        file = folder / table.text("gains_file")
        kind, controller, _ = load_gains(file, case, model)
        if table.text("type", kind) != kind:
            raise ConfigError(
                f"controller.type is {table.text('type')!r}, but {file} holds {kind!r}."
            )
    else:
        kind = table.text("type", "fxtppc")
        choice(kind, dict.fromkeys(paper.CONTROLLERS), "controller.type")
        controller = paper.make_controller(kind, case, model)
    return kind, decode(controller, table.rest(), "controller")
