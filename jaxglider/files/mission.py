"""A user's own mission as TOML: vehicle, sea, task, controller, clock.

Every key carries its unit. What is left out takes the value of the paper's first case.
`TEMPLATE` is a complete, commented file.
"""

import dataclasses
import datetime
import functools
import math
from importlib import resources
from pathlib import Path
from typing import Any

from jaxglider import paper
from jaxglider.control import Funnel
from jaxglider.core.toml import ConfigError, TomlTable, choice, read_toml
from jaxglider.files.codec import decode
from jaxglider.files.course_remarks import (
    case_of,
    course_remarks,
    stand_ins,
    vehicle_remarks,
    with_tuned_gains,
)
from jaxglider.files.file_kinds import refuse_other_kind
from jaxglider.files.flight.sensor_tables import read_reckoning, read_sensors
from jaxglider.files.flight.start_tables import (
    read_initial_state,
    read_origin,
    read_water,
)
from jaxglider.files.flight.yo_tables import read_energy, read_seabed
from jaxglider.files.gains import (
    decode_gains,
    decode_observer,
    kind_of,
    mission_estimator,
    read_gains,
    with_law_found,
    with_law_inside,
)
from jaxglider.files.law_paths import is_same_law, short_name
from jaxglider.files.mission_tables import (
    read_actuators,
    read_clock,
    read_disturbance,
    read_reference,
    read_vehicle,
)
from jaxglider.files.sea.located import with_sea_inside
from jaxglider.files.sea.moment import started
from jaxglider.files.user_law import first_gains
from jaxglider.guidance.routes import route_of
from jaxglider.signals import CHANNELS, Channels
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.gains import LoadedGains
from jaxglider.simulation.scenario import Scenario
from jaxglider.simulation.specification import Specification
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant

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
        loop: closed loop to be flown.
        seed: seed of the sea.
        law: law, observer and guidance of the loop, by themselves.
        model: design model that laws for this mission begin with.
        plant: name of the plant.
        vehicle: name of the vehicle.
        remarks: oddities of a course or a vehicle that can be flown.
        stand_ins: sentences on what is the paper's or the vehicle's because its table
            is left out; empty where nothing is.
        start: date of the start in UTC, or None.
    """

    name: str
    loop: ClosedLoop
    seed: int
    law: LoadedGains
    model: DesignModel
    plant: str
    vehicle: str = ""
    remarks: tuple[str, ...] = ()
    stand_ins: str = ""
    start: datetime.datetime | None = None

    @property
    def controller(self) -> str:
        """Name of the law, for tables."""
        return short_name(self.law.kind)


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
    refuse_other_kind(data, "mission")
    data = with_tuned_gains(with_sea_inside(data, folder))
    top = TomlTable(data, "")
    name, seed = top.text("name", "mission"), top.whole("seed", 0)
    if not 0 <= seed < SEEDS:
        raise ConfigError(f"seed must be in [0, {SEEDS}); received {seed}.")
    vehicle, plant_name, plant, model = _glider(top.table("vehicle"), folder)
    task, case = top.table("reference"), case_of(data)
    prescribed = _specification(top, case, plant)
    law = _law(top.get("controller", {}), model, case, prescribed.funnel, folder)
    start = top.table("initial_state")
    origin = read_origin(start)
    water = read_water(top.table("water"), vehicle)
    parts = (
        read_clock(top.table("clock")),
        plant,
        read_actuators(
            top.table("actuators"), vehicle, paper.default_actuators(plant_name)
        ),
        read_disturbance(top.tables("disturbance")),
        read_reference(
            task, law.guidance or paper.guidance(), origin, vehicle.fin is None
        ),
        read_initial_state(start, origin, water),
    )
    energy = read_energy(top.table("energy"), vehicle.energy)
    instruments = read_sensors(_optional(top, "sensors"), vehicle.sensors)
    try:
        scenario = Scenario(
            *parts,
            specification=prescribed,
            origin=origin,
            water=water,
            seabed=read_seabed(_optional(top, "seabed")),
            energy=energy,
            instruments=instruments,
            reckoning=read_reckoning(instruments, plant, vehicle),
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error
    observer = decode_observer(top.table("observer").rest(), law.observer, model)
    estimator = mission_estimator(
        top.get("estimator", None), law.estimator, model, scenario.instruments
    )
    top.close()
    path = route_of(scenario.reference)
    guidance = None if path is None else path.line_of_sight
    law = law._replace(observer=observer, guidance=guidance, estimator=estimator)
    loop, beyond = law.on(scenario), vehicle_remarks(vehicle, plant_name, parts[2])
    told = (*course_remarks(data), *beyond), stand_ins(data), started(data)
    return Mission(name, loop, seed, law, model, plant_name, vehicle.name, *told)


def _optional(top: TomlTable, name: str) -> TomlTable | None:
    """A table, or None where the file has none of the name."""
    return None if top.get(name, None) is None else top.table(name)


def _glider(
    table: TomlTable, folder: Path
) -> tuple[VehicleData, str, AbstractPlant, DesignModel]:
    """Vehicle, name of its plant, plant, and the design model of its laws."""
    vehicle = read_vehicle(table, folder)
    name = table.text("plant", "printed")
    make_plant = choice(name, paper.PLANTS, "vehicle.plant")
    factor = table.number("design_factor", paper.DESIGN_FACTOR)
    table.close()
    try:
        plant = make_plant(vehicle)
    except ValueError as error:
        raise ConfigError(f"vehicle.plant: {error}") from error
    if factor <= 0.0:
        raise ConfigError(f"vehicle.design_factor must be positive; received {factor}.")
    try:
        return vehicle, name, plant, paper.design_model(plant, factor)
    except ValueError as error:
        raise ConfigError(f"vehicle.design_factor: {error}") from error


def self_contained(path: str | Path) -> dict[str, Any]:
    """A mission file's tables with the files it names put in their places.

    `build_mission` makes the same mission of them without the files.

    Raises:
        ConfigError: a file cannot be read.
    """
    folder = Path(path).parent
    data = with_tuned_gains(with_sea_inside(read_toml(path), folder))
    vehicle, controller = data.get("vehicle"), data.get("controller")
    if isinstance(vehicle, dict):
        file = vehicle.get("data")
        # A vehicle without the ending is one of the package's.
        if isinstance(file, str) and file.endswith(".toml"):
            data["vehicle"] = vehicle | {"data": read_toml(folder / file)}
    if isinstance(controller, dict):
        file = controller.get("gains_file")
        if isinstance(file, str):
            tables = with_law_inside(read_gains(folder / file))
            controller = controller | {"gains_file": tables}
        data["controller"] = with_law_found(controller, folder)
    return with_law_inside(data)


def _specification(top: TomlTable, case: str, plant: AbstractPlant) -> Specification:
    """P_spec of the table `funnel` and the rest of the table `specification`.

    What both leave out is that of the paper's case.
    """
    first = paper.specification(case, plant)
    funnel = decode(first.funnel, top.get("funnel", {}), "funnel")
    table = top.table("specification")
    times, limit = table.get("settling_time_s", None), first.largest_roll
    if times is not None:
        times = Channels(*table.numbers("settling_time_s", length=len(CHANNELS)))
    if table.get("largest_roll_deg", None) == "none":
        limit = None
    elif table.get("largest_roll_deg", None) is not None:
        limit = math.radians(table.number("largest_roll_deg"))
    share = None
    if table.get("saturated_share", None) is not None:
        share = table.number("saturated_share")
    table.close()
    try:
        return Specification(funnel, times, limit, share)
    except ValueError as error:
        raise ConfigError(f"specification: {error}") from error


def _law(
    data: Any, model: DesignModel, case: str, funnel: Funnel, folder: Path
) -> LoadedGains:
    """Gains of the table over those of its gains file, or over the law's first."""
    complete = with_law_found(data, folder) if isinstance(data, dict) else data
    table = TomlTable(complete, "controller")
    source = table.get("gains_file", None)
    if source is None:
        kind, text = kind_of(table, "fxtppc")
        law = first_gains(kind, case, model, funnel, text)
    else:
        law, file = _filed_law(table, source, (case, model, funnel), folder)
        kind, _ = kind_of(table, law.kind)
        if not is_same_law(kind, law.kind):
            raise ConfigError(
                f"controller.type must be {law.kind!r}, the kind that {file} holds; "
                f"received {kind!r}. Change one of the two."
            )
    controller = decode(
        law.controller, table.rest(), "controller", beside=("gains_file",)
    )
    return law._replace(controller=controller)


def _filed_law(
    table: TomlTable, source: Any, beginning: tuple[Any, ...], folder: Path
) -> tuple[LoadedGains, str]:
    """Gains from a file, or from its tables in its place; and what to call it."""
    where = table.where("gains_file")
    if not isinstance(source, dict):
        where = str(folder / table.text("gains_file"))
        source = read_gains(where)
    try:
        return decode_gains(source, *beginning), where
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
