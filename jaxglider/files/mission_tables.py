"""Tables of a mission file turned into vehicle, sea, task and clock.

Each function reads one table, refuses what it does not know, and names the key in every
complaint.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider import paper
from jaxglider.core.toml import (
    ConfigError,
    TomlTable,
    choice,
    number,
    reason,
    refuse_unknown,
)
from jaxglider.environment.disturbances import (
    AbstractDisturbance,
    Calm,
    Constant,
    GaussMarkov,
    Sinusoid,
    Sum,
)
from jaxglider.files.flight.yo_tables import (
    built,
    read_course,
    read_pump,
    read_sampled_clock,
    read_yo,
)
from jaxglider.guidance import (
    AbstractReference,
    AttitudeSchedule,
    LineOfSight,
    Schedule,
    WaypointPath,
)
from jaxglider.signals import COMMAND_UNITS, BodyAxes, Command
from jaxglider.simulation.origin import Origin
from jaxglider.simulation.scenario import Clock
from jaxglider.vehicle.actuators import (
    ACTUATOR_KINDS,
    Actuator,
    make_actuators,
)
from jaxglider.vehicle.parameters import GliderParameters, VehicleData
from jaxglider.vehicle.published import load_vehicle, vehicle_names, vehicle_of


def read_vehicle(table: TomlTable, folder: Path) -> VehicleData:
    """Parameters and actuator limits, with overrides applied."""
    vehicle = built(_published, "vehicle.data", table, folder)
    overrides = table.table("parameters").rest()
    names = [f.name for f in dataclasses.fields(GliderParameters)]
    refuse_unknown(
        [k for k in overrides if k not in names], names, "vehicle.parameters"
    )
    values = {k: number(v, f"vehicle.parameters.{k}") for k, v in overrides.items()}
    parameters = built(
        dataclasses.replace, "vehicle.parameters", vehicle.parameters, **values
    )
    return dataclasses.replace(vehicle, parameters=parameters)


def _published(table: TomlTable, folder: Path) -> VehicleData:
    """A vehicle of the package, of a file, or of a table in the place of its name."""
    source = table.get("data", "seawing")
    if isinstance(source, dict):
        return vehicle_of(source, "the table")
    name = table.text("data", "seawing")
    if not name.endswith(".toml"):
        return load_vehicle(name)
    file = folder / name
    try:
        return load_vehicle(file)
    except OSError as error:
        raise ConfigError(
            f"vehicle.data must be {', '.join(vehicle_names())} or the path of a .toml "
            f"file from the mission's folder; received {name!r}, and "
            f"{file.absolute()} cannot be read: {reason(error)}. `jaxglider vehicles "
            "--show NAME` prints a file to start from."
        ) from error


def read_clock(table: TomlTable) -> Clock:
    """Tick and horizon."""
    duration = table.number("duration_s", 800.0)
    table.get("start", None)  # a date: of the sea's files, and of those written
    if table.get("period_s", None) is not None:
        return read_sampled_clock(table, duration)
    dt = table.number("dt_s", 0.05)
    substeps = table.whole("substeps", 1)
    table.close()
    return built(Clock.lasting, "clock", duration, dt, substeps)


def read_actuators(
    table: TomlTable, vehicle: VehicleData, default: str
) -> Command[Actuator]:
    """The three actuators; limits, and rates of `vehicle` ones, are the vehicle's.

    Args:
        table: table to read.
        vehicle: vehicle that has them.
        default: kind where the table does not say, `vehicle` or `ideal`.
    """
    kinds = {kind: kind for kind in ACTUATOR_KINDS}
    kind = choice(table.text("type", default), kinds, table.where("type"))
    own = make_actuators(vehicle, kind)
    actuators = {}
    for name, unit in COMMAND_UNITS.items():
        one = table.table(name)
        rate = one.get(f"rate_limit_{unit}_s", None)
        lag = one.get("time_constant_s", None)
        # A pump has one of its own, see `read_pump`.
        band = None if unit == "kg" else one.get(f"dead_band_{unit}", None)
        usual = getattr(own, name)
        actuators[name] = built(
            Actuator,
            one.where("")[:-1],
            one.number(f"limit_{unit}", float(usual.limit)),
            usual.rate_limit if rate is None else one.number(f"rate_limit_{unit}_s"),
            None if lag is None else one.number("time_constant_s"),
            dead_band=None if band is None else one.number(f"dead_band_{unit}"),
        )
        if kind == "vehicle" and name == "buoyancy_mass" and rate is lag is None:
            limit = float(actuators[name].limit)
            actuators[name] = read_pump(one, limit, vehicle.pump) or actuators[name]
        one.close()
    table.close()
    return Command(**actuators)


def read_disturbance(tables: list[TomlTable]) -> AbstractDisturbance:
    """The sum of the disturbances listed."""
    kinds = {
        "calm": lambda t: Calm(),
        "constant": lambda t: Constant(_axes(t, "force_N", "moment_N_m")),
        "sinusoid": _sinusoid,
        "coloured-noise": _coloured_noise,
        "paper": lambda t: paper.disturbance(),
    }
    terms = []
    for table in tables:
        make = choice(table.get("type"), kinds, table.where("type"))
        terms.append(built(make, table.where("")[:-1], table))
        table.close()
    return Sum(tuple(terms))


def _axes(table: TomlTable, force: str, moment: str) -> BodyAxes[Any]:
    zero = [0.0] * 3
    return BodyAxes(*table.numbers(force, zero, 3), *table.numbers(moment, zero, 3))


def _sinusoid(table: TomlTable) -> Sinusoid:
    periods = table.numbers("period_s", length=6)
    if min(periods) <= 0.0:
        raise ConfigError(
            f"{table.where('period_s')} must be positive; received {min(periods):g}."
        )
    phases = table.numbers("phase_deg", 0.0, 6)
    return Sinusoid(
        _axes(table, "amplitude_N", "amplitude_N_m"),
        BodyAxes(*(2 * math.pi / p for p in periods)),
        BodyAxes(*(math.radians(p) for p in phases)),
    )


def _coloured_noise(table: TomlTable) -> GaussMarkov:
    return GaussMarkov(
        _axes(table, "standard_deviation_N", "standard_deviation_N_m"),
        BodyAxes(*table.numbers("correlation_time_s", length=6)),
    )


WAYPOINT_KEYS = (
    "north_m",
    "east_m",
    "latitude_deg",
    "longitude_deg",
    "file",
    "radius_m",
    "abeam_m",
    "lookahead_m",
    "integral_gain",
    "start_north_m",
    "start_east_m",
)


def read_reference(
    table: TomlTable, guidance: LineOfSight, origin: Origin, turns_mass: bool = True
) -> AbstractReference:
    """The task: a schedule, a waypoint path, or yos.

    Args:
        table: table of the file.
        guidance: gains of a path that gives none of its own.
        origin: place that its positions will count from.
        turns_mass: flag, the vehicle steers by its moving mass, not by a fin.
    """
    kind = table.text("type", "schedule")
    choice(kind, {"schedule": 0, "waypoints": 0, "yo": 0}, table.where("type"))
    if kind == "yo":
        if table.get("waypoints", None) is None:
            course, spiral = read_course(table, turns_mass)
        else:
            level = Schedule([0.0], [0.0], [0.0], [0.0])
            course = _waypoints(table.table("waypoints"), guidance, origin, level)
            spiral = None, turns_mass
        mission = read_yo(table.table("yo"), course, spiral)
        table.close()
        return mission
    if kind == "schedule" and table.get("waypoints", None) is not None:
        raise ConfigError(
            'reference.waypoints needs reference.type = "waypoints"; received '
            '"schedule". Change the type or remove the waypoints.'
        )
    schedule = _schedule(table.table("schedule"), kind)
    if kind == "schedule":
        table.close()
        return AttitudeSchedule(schedule)
    path = _waypoints(table.table("waypoints"), guidance, origin, schedule)
    table.close()
    return path


def _waypoints(
    path: TomlTable, guidance: LineOfSight, origin: Origin, schedule: Schedule
) -> WaypointPath:
    """A path of waypoints with a schedule for its depth."""
    where = "reference.waypoints"
    if origin.moved:
        where += f" (from the start at {origin.north:.10g}, {origin.east:.10g} on)"
    path.only(WAYPOINT_KEYS)
    course: WaypointPath = built(
        WaypointPath,
        where,
        [x - origin.north for x in path.numbers("north_m")],
        [x - origin.east for x in path.numbers("east_m")],
        built(
            LineOfSight,
            "reference.waypoints",
            path.number("lookahead_m", float(guidance.lookahead)),
            path.number("integral_gain", float(guidance.integral_gain)),
        ),
        schedule,
        path.number("radius_m", 5.0),
        path.number("start_north_m", 0.0) - origin.north,
        path.number("start_east_m", 0.0) - origin.east,
        None if path.get("abeam_m", None) is None else path.number("abeam_m"),
    )
    path.close()
    return course


def _schedule(table: TomlTable, kind: str) -> Schedule:
    default = (
        paper.attitude_schedule() if kind == "schedule" else paper.vertical_schedule()
    )
    start = table.numbers("start_s", np.asarray(default.start).tolist())
    count = len(start)
    if count == 0:
        raise ConfigError(
            f"{table.where('start_s')} must have at least 1 number; received []."
        )
    own = not np.array_equal(start, np.asarray(default.start))

    def column(key: str, fallback: Any, scale: float = 1.0) -> list[float]:
        if own:
            values = table.numbers(key, length=count)
        else:
            values = table.numbers(key, (np.asarray(fallback) / scale).tolist(), count)
        return [scale * v for v in values]

    degrees = math.pi / 180
    no_heading = kind == "waypoints" and table.get("heading_deg", None) is None
    heading = (
        [0.0] * count if no_heading else column("heading_deg", default.heading, degrees)
    )
    schedule = built(
        Schedule,
        "reference.schedule",
        start,
        column("gliding_angle_deg", default.gliding_angle, degrees),
        heading,
        column("depth_rate_m_s", default.depth_rate),
        table.number("initial_depth_m", 0.0),
    )
    table.close()
    return schedule
