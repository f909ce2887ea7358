"""A user's own mission as TOML: vehicle, sea, task, controller, clock.

Every key carries its unit. What is left out takes the value of the paper's first case.
`TEMPLATE` is a complete, commented file.
"""

import dataclasses
import functools
from importlib import resources
from pathlib import Path
from typing import Any

from jaxglider import paper
from jaxglider.core.toml import ConfigError, TomlTable, choice, read_toml
from jaxglider.files.codec import decode
from jaxglider.files.gains import LoadedGains, decode_gains, decode_observer, load_gains
from jaxglider.files.mission_tables import (
    read_actuators,
    read_clock,
    read_disturbance,
    read_initial_state,
    read_reference,
    read_vehicle,
    read_water,
)
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario

TEMPLATE = functools.partial(
    (resources.files("jaxglider.files") / "templates" / "mission.toml").read_text,
    encoding="utf-8",
)
"""Call it for the text of a complete, commented mission file."""

SEEDS = 2**32
"""Seeds are below this: what a key of JAX takes in either precision."""


@dataclasses.dataclass(frozen=True)
class Mission:
    """Content of a mission file.

    Attributes:
        name: name of the mission.
        loop: the closed loop.
        seed: seed of the sea.
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
    top = TomlTable(data, "")
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
        within = data.get(table)
        if not isinstance(within, dict):
            continue
        named = within.get(key)
        # A vehicle without the ending is one of the package's.
        if isinstance(named, str) and (table != "vehicle" or named.endswith(".toml")):
            data[table] = within | {key: read_toml(folder / named)}
    return data


def _funnel(table: Any, case: str) -> Any:
    return None if table is None else decode(paper.funnel(case), table, "funnel")


def _law(table: TomlTable, model: Any, case: str, folder: Path) -> LoadedGains:
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
    table: TomlTable, source: Any, model: Any, case: str, folder: Path
) -> tuple[LoadedGains, str]:
    """Gains from a file, or from its tables in its place; and what to call it."""
    if not isinstance(source, dict):
        file = folder / table.text("gains_file")
        return load_gains(file, case, model), str(file)
    where = table.where("gains_file")
    try:
        return decode_gains(source, case, model), where
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
