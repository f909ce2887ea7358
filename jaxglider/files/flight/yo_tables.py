"""Tables of a yo mission turned into phases, seabed and energy.

Each function reads one table, refuses what it does not know, and names the key in every
complaint. Angles in keys ending in `_deg` are degrees.
"""

import dataclasses
import math
from typing import Any

from jaxglider.core.toml import ConfigError, TomlTable, choice
from jaxglider.environment.seabed import Seabed
from jaxglider.environment.tables import SeabedGrid
from jaxglider.guidance import AbstractReference, AttitudeSchedule, Schedule
from jaxglider.guidance.phases import (
    ORDERS,
    HalfYo,
    StopRules,
    SurfaceStay,
    Turning,
)
from jaxglider.guidance.settings import YoSettings
from jaxglider.guidance.yo import Yo
from jaxglider.simulation.scenario import Clock
from jaxglider.vehicle.actuators import Actuator
from jaxglider.vehicle.energy import EnergyModel, Pump

DEGREE = math.pi / 180.0

STOP_KEYS = {
    "hover_rate": "hover_rate_m_s",
    "hover_time": "hover_time_s",
    "stall_time": "stall_time_s",
    "depth_rate_limit": "depth_rate_limit_m_s",
    "rate_memory": "rate_memory_s",
}
"""Keys of `[reference.yo.stop]` by the fields of `StopRules`."""
ENERGY_KEYS = {
    "per_shift": "per_shift_J_m",
    "per_turn": "per_turn_J_rad",
    "hotel": "hotel_W",
    "surface": "surface_W",
    "call": "call_J",
    "battery": "battery_J",
}
"""Keys of `[energy]` by the fields of `EnergyModel`."""
PUMP_KEYS = {
    "push_rate": "push_rate_kg_s",
    "draw_rate": "draw_rate_kg_s",
    "boost_rate": "boost_rate_kg_s",
    "boost_above": "boost_above_m",
    "dead_band": "dead_band_kg",
}
"""Keys of `[actuators.buoyancy_mass]` that make it a pump, by the fields of `Pump`."""


def built(make: Any, path: str, *args: Any, **kwargs: Any) -> Any:
    """Result of a class called; its complaint with the path of the table.

    Args:
        make: class or function.
        path: path of the table, for the message.
        args: arguments.
        kwargs: arguments by name.

    Raises:
        ConfigError: it has refused one.
    """
    try:
        return make(*args, **kwargs)
    except ConfigError:
        raise
    except (OSError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


def read_sampled_clock(table: TomlTable, duration: float) -> Clock:
    """A clock with a control period and an integration step of its own."""
    period = table.number("period_s")
    step = table.number("step_s", min(period, 0.5))
    table.close()
    clock: Clock = built(Clock.sampled, "clock", duration, period, step)
    return clock


def read_pump(table: TomlTable, limit: float, known: Any) -> Actuator | None:
    """The buoyancy engine as a pump, where the file or the vehicle gives its rates.

    Args:
        table: table of the actuator; its other keys have been read.
        limit: largest modulus of the ballast [kg].
        known: rates of the vehicle's file by the fields of `Pump`.
    """
    values = dict(known)
    for name, key in PUMP_KEYS.items():
        if table.get(key, None) is not None:
            values[name] = table.number(key)
    if not values:
        return None
    for name in ("push_rate", "draw_rate"):
        if name not in values:
            table.number(PUMP_KEYS[name])
    pump: Pump = built(Pump, table.where("")[:-1], limit, **values)
    return pump


def read_seabed(table: TomlTable | None) -> Seabed | SeabedGrid | None:
    """The bottom of the sea, if the mission has one."""
    if table is None:
        return None
    if table.get("grid", None) is not None:
        own = table.table("grid")
        axes = [own.numbers(key) for key in ("north_m", "east_m")]
        rows = own.rows("depth_m")
        own.close()
        table.close()
        grid: SeabedGrid = built(SeabedGrid, "seabed.grid", *axes, rows)
        return grid
    values = [table.number(key, 0.0) for key in ("slope_north", "slope_east")]
    depth = table.number("depth_m")
    table.close()
    seabed: Seabed = built(Seabed, "seabed", depth, *values)
    return seabed


def read_energy(table: TomlTable, vehicle: EnergyModel | None) -> EnergyModel | None:
    """The consumption of the vehicle, with the numbers of the mission in place of its.

    Args:
        table: table of the mission, empty if it has none.
        vehicle: consumption that the vehicle's file gives, or None.
    """
    values = {
        name: table.number(key)
        for name, key in ENERGY_KEYS.items()
        if table.get(key, None) is not None
    }
    table.close()
    if not values:
        return vehicle
    if vehicle is None:
        model: EnergyModel = built(EnergyModel, "energy", **values)
        return model
    changed: EnergyModel = built(dataclasses.replace, "energy", vehicle, **values)
    return changed


def read_course(
    table: TomlTable, turns_mass: bool
) -> tuple[AbstractReference, tuple[float | None, bool]]:
    """A constant heading, and the steering angle of a spiral with its change of sign.

    Args:
        table: table of the reference, which has no waypoints.
        turns_mass: flag, the vehicle steers by its moving mass: then the angle changes
            its sign in climbs where the mission does not say.
    """
    heading, flips = 0.0, turns_mass
    if table.get("heading_deg", None) is not None:
        heading = DEGREE * table.number("heading_deg")
    spiral = None
    if table.get("spiral", None) is not None:
        own = table.table("spiral")
        spiral = DEGREE * own.number("steering_angle_deg")
        flips = _flag(own, "changes_sign", turns_mass)
        own.close()
    schedule = Schedule([0.0], [0.0], [heading], [0.0])
    return AttitudeSchedule(schedule), (spiral, flips)


def read_yo(
    table: TomlTable, course: AbstractReference, spiral: tuple[float | None, bool]
) -> Yo:
    """A yo mission.

    Args:
        table: table of its settings.
        course: reference whose heading it follows.
        spiral: steering angle that it holds instead [rad] or None, and whether that
            angle changes its sign in climbs.
    """
    where = table.where("")[:-1]
    halves = {name: _half(table.table(name), name) for name in ("dive", "climb")}
    parts = {
        **halves,
        "apogee": _turning(table.table("apogee"), "pump", 900.0),
        "inflection": _turning(table.table("inflection"), "mass", 30.0),
        "surface": _stay(table.table("surface"), halves["climb"]),
        "stop": _stop(table.table("stop")),
    }
    numbers = {
        "bottom": table.number("bottom_depth_m"),
        "top": table.number("top_depth_m", 3.0),
        "early_share": table.number("early_share", 0.25),
        "early_most": table.number("early_most_m", 25.0),
        "altimeter_range": table.number("altimeter_range_m", 100.0),
        "altitude": _maybe(table, "altitude_m"),
        "duration": _maybe(table, "duration_s"),
    }
    yos = None if table.get("yos", None) is None else table.whole("yos")
    table.close()
    settings = built(
        YoSettings,
        where,
        **parts,
        **numbers,
        yos=yos,
        spiral=spiral[0],
        spiral_flips=spiral[1],
    )
    return Yo(course, settings)


def _flag(table: TomlTable, key: str, default: bool) -> bool:
    value = table.get(key, default)
    if not isinstance(value, bool):
        raise ConfigError(
            f"{table.where(key)} must be true or false; received {value!r}."
        )
    return value


def _maybe(table: TomlTable, key: str, unit: float = 1.0) -> float | None:
    return None if table.get(key, None) is None else unit * table.number(key)


def _half(table: TomlTable, name: str) -> HalfYo:
    """A way down or up, its angle that of the pitch or of the path."""
    of_path = table.get("gliding_angle_deg", None) is not None
    if of_path and table.get("pitch_deg", None) is not None:
        raise ConfigError(
            f"{table.where('pitch_deg')} and gliding_angle_deg say the same twice; "
            "leave one out."
        )
    angle = DEGREE * table.number("gliding_angle_deg" if of_path else "pitch_deg")
    ballast = table.number("buoyancy_mass_kg")
    half: HalfYo = built(
        HalfYo,
        table.where("")[:-1],
        angle,
        ballast,
        of_path,
        _maybe(table, "depth_rate_m_s"),
        _maybe(table, "adjust_every_s"),
        table.number("depth_rate_band_m_s", 0.005),
        table.number("ballast_gain_kg_s_m", 2.0),
        table.number("largest_buoyancy_mass_kg", 2.0 * abs(ballast)),
        _maybe(table, "steering_limit_deg", DEGREE),
        _maybe(table, "steering_wait_s"),
    )
    table.close()
    return half


def _turning(table: TomlTable, order: str, longest: float) -> Turning:
    first = table.text("first", order)
    choice(first, dict.fromkeys(ORDERS), table.where("first"))
    turning: Turning = built(
        Turning,
        table.where("")[:-1],
        first,
        table.number("longest_s", longest),
        _maybe(table, "pitch_deg", DEGREE),
        _maybe(table, "buoyancy_mass_kg"),
        _maybe(table, "steering_limit_deg", DEGREE),
    )
    table.close()
    return turning


def _stay(table: TomlTable, climb: HalfYo) -> SurfaceStay:
    every = None if table.get("every_yos", None) is None else table.whole("every_yos")
    stay: SurfaceStay = built(
        SurfaceStay,
        table.where("")[:-1],
        depth=table.number("depth_m", 2.0),
        duration=table.number("duration_s", 600.0),
        first=table.number("first_s", 0.0),
        angle=DEGREE * table.number("pitch_deg", -20.0),
        buoyancy_mass=table.number("buoyancy_mass_kg", float(climb.buoyancy_mass)),
        every_yos=every,
        every=_maybe(table, "every_s"),
        at_waypoints=_flag(table, "at_waypoints", False),
    )
    table.close()
    return stay


def _stop(table: TomlTable) -> StopRules:
    default = StopRules()
    values = {
        name: table.number(key, float(getattr(default, name)))
        for name, key in STOP_KEYS.items()
    }
    table.close()
    stop: StopRules = built(StopRules, table.where("")[:-1], **values)
    return stop
