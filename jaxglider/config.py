"""A user's own mission as TOML: vehicle, sea, task, controller, clock.

Every key carries its unit. What is left out takes the value of the paper's first case.
`TEMPLATE` is a complete, commented file.
"""

import dataclasses
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

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
from jaxglider.controllers import AbstractController, tracking_error
from jaxglider.controllers.base import Limits
from jaxglider.gains import decode, encode
from jaxglider.observer import AbstractObserver
from jaxglider.references import LineOfSight, WaypointPath
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
    if factor <= 0.0:
        raise ConfigError(f"vehicle.design_factor must be positive; received {factor}.")
    model = paper.design_model(plant, factor)
    task = top.table("reference")
    case = paper_case(task.text("type", "schedule") == "waypoints")
    law = _law(top.table("controller"), model, case, folder)
    scenario = Scenario(
        read_clock(top.table("clock")),
        plant,
        read_actuators(top.table("actuators"), vehicle.limits),
        read_disturbance(top.tables("disturbance")),
        read_reference(task, law.guidance or paper.guidance()),
        read_initial_state(top.table("initial_state")),
        funnel=_funnel(top.get("funnel", None), case),
        water=read_water(top.table("water"), vehicle),
    )
    table = top.table("observer")
    observer = decode_observer(table.rest(), law.kind, model, law.observer)
    top.close()
    loop = ClosedLoop(scenario, law.controller, observer)
    return Mission(name, loop, seed, law.kind, plant_name)


def paper_case(has_waypoints: bool) -> str:
    """The case of the paper whose gains and funnel a task is given by default."""
    return "waypoints" if has_waypoints else "switching"


def self_contained(path: str | Path) -> dict[str, Any]:
    """A mission file's tables with the files it names put in their places.

    `build_mission` makes the same mission of them without the files.

    Raises:
        ConfigError: a file cannot be read.
    """
    folder, data = Path(path).parent, read_toml(path)
    for table, key in (("vehicle", "data"), ("controller", "gains_file")):
        named = data.get(table)
        if isinstance(named, dict) and str(named.get(key, "")).endswith(".toml"):
            data[table] = named | {key: read_toml(folder / named[key])}
    return data


def _funnel(table: Any, case: str) -> Any:
    return None if table is None else decode(paper.funnel(case), table, "funnel")


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


class Law(NamedTuple):
    """What a gains file holds.

    Attributes:
        kind: name of the controller's kind.
        controller: with its gains.
        observer: likewise.
        guidance: gains of the line of sight, or None where the file has none.
    """

    kind: str
    controller: AbstractController
    observer: AbstractObserver
    guidance: LineOfSight | None

    def on(self, scenario: Scenario) -> ClosedLoop:
        """The closed loop that steers a scenario with these gains.

        Guidance that the file has replaces that of a waypoint path; a schedule has
        none, and keeps its headings.
        """
        path = scenario.reference
        if self.guidance is not None and isinstance(path, WaypointPath):
            path = dataclasses.replace(path, line_of_sight=self.guidance)
            scenario = dataclasses.replace(scenario, reference=path)
        return ClosedLoop(scenario, self.controller, self.observer)


def encode_law(loop: ClosedLoop) -> dict[str, Any]:
    """Gains of a closed loop as the tables of a gains file."""
    tables = {
        "format": 1,
        "controller": encode(loop.controller),
        "observer": encode(loop.observer),
    }
    path = loop.scenario.reference
    if isinstance(path, WaypointPath):
        tables["guidance"] = encode(path.line_of_sight)
    return tables


def load_gains(path: str | Path, scenario: str, model: Any) -> Law:
    """Read a gains file.

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


def decode_gains(data: dict[str, Any], scenario: str, model: Any) -> Law:
    """Gains from parsed TOML.

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
    guidance = top.get("guidance", None)
    if guidance is not None:
        guidance = decode(paper.guidance(), guidance, "guidance")
    top.get("provenance", None)
    choice(str(top.get("format", 1)), {"1": 1}, "format")
    top.close()
    return Law(kind, controller, observer, guidance)


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


def _law(table: Table, model: Any, case: str, folder: Path) -> Law:
    """Gains of the table over those of its gains file, or over the paper's."""
    source = table.get("gains_file", None)
    if source is None:
        kind = table.text("type", "fxtppc")
        law = decode_gains({"controller": {"type": kind}}, case, model)
    else:
        law, file = _filed_law(table, source, model, case, folder)
        if table.text("type", law.kind) != law.kind:
            raise ConfigError(
                f"controller.type must be {law.kind!r}, the kind that {file} holds; "
                f"received {table.text('type')!r}. Change one of the two."
            )
    return law._replace(controller=decode(law.controller, table.rest(), "controller"))


def _filed_law(
    table: Table, source: Any, model: Any, case: str, folder: Path
) -> tuple[Law, str]:
    """Gains from a file, or from its tables in its place; and what to call it."""
    if not isinstance(source, dict):
        file = folder / table.text("gains_file")
        return load_gains(file, case, model), str(file)
    where = table.where("gains_file")
    try:
        return decode_gains(source, case, model), where
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
