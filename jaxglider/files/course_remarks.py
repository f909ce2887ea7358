"""Remarks on a mission that can be flown: what is hardly meant so, or not its own.

What is not its own is the paper's: the case that it is nearest to, and the gains tuned
for that.
"""

import math
from typing import Any

from jaxglider import paper
from jaxglider.core.toml import ConfigError
from jaxglider.paper.tuned import has_tuned_gains, tuned_gains
from jaxglider.signals import COMMAND_UNITS, Command
from jaxglider.vehicle.parameters import VehicleData

FASTEST = 3.0
"""No glider is faster through the water, nor any current [m/s]."""
_OF_THE_PAPER = {
    "vehicle": "SeaWing on the printed plant",
    "reference": "a schedule of four attitudes",
    "reference.schedule": "gliding angles and depth rates",
    "controller": "FxTPPC and its gains",
    "clock": "800 s in ticks of 0.05 s",
}
"""The stand-ins for tables that are left out, from the paper's cases."""

TUNED = "tuned"
"""Word for the gains that come along, in place of the path of a gains file."""


def case_of(data: dict[str, Any]) -> str:
    """The case of the paper that a mission takes what it leaves out from.

    Args:
        data: tables of a mission file.
    """
    task = data.get("reference", {})
    kind = task.get("type", "schedule") if isinstance(task, dict) else ""
    yo_route = kind == "yo" and task.get("waypoints") is not None
    return paper_case(kind == "waypoints" or yo_route)


def paper_case(has_waypoints: bool) -> str:
    """The case of the paper whose gains and funnel a task is given by default."""
    return "waypoints" if has_waypoints else "switching"


def with_tuned_gains(data: dict[str, Any]) -> dict[str, Any]:
    """A mission's tables with the file of gains that the word `tuned` stands for.

    Args:
        data: tables of a mission file.

    Raises:
        ConfigError: no gains come along for this law, case and plant.
    """
    controller, vehicle = data.get("controller", {}), data.get("vehicle", {})
    if not isinstance(controller, dict) or controller.get("gains_file") != TUNED:
        return data
    plant = vehicle.get("plant", "printed") if isinstance(vehicle, dict) else ""
    kind = str(controller.get("type", "fxtppc"))
    task = str(data.get("name", ""))
    try:
        if not has_tuned_gains(task, str(plant), kind):
            task = case_of(data)
        file = tuned_gains(task, str(plant), kind)
    except ValueError as error:
        raise ConfigError(f"controller.gains_file: {error}") from error
    return data | {"controller": controller | {"gains_file": str(file)}}


def course_remarks(data: dict[str, Any]) -> tuple[str, ...]:
    """Remarks on the waypoints of a mission.

    Args:
        data: tables of a mission file that has been read without complaint.
    """
    path = data.get("reference", {}).get("waypoints")
    if path is None:
        return ()
    north, east = _listed(path["north_m"]), _listed(path["east_m"])
    start = data.get("initial_state", {})
    place = float(start.get("north_m", 0.0)), float(start.get("east_m", 0.0))
    duration = float(data.get("clock", {}).get("duration_s", 800.0))
    remarks = _beside_the_leg(path, place)
    away = math.hypot(north[0] - place[0], east[0] - place[1])
    # On Earth these metres may have been made of degrees.
    metres_alone = "latitude_deg" not in start
    if metres_alone and _like_degrees_and_minutes(north, east):
        remarks.append(
            f"waypoints as ({north[0]:.10g}, {east[0]:.10g}) look like degrees and "
            "minutes (DDMM.mmm, as in a goto file), and are taken as metres: name the "
            "goto list itself, reference.waypoints.file, or give latitude_deg and "
            "longitude_deg in decimal degrees."
        )
    elif metres_alone and _like_decimal_degrees(north, east):
        remarks.append(
            f"waypoints as ({north[0]:.10g}, {east[0]:.10g}) look like decimal "
            "degrees, and are taken as metres: as degrees they are latitude_deg and "
            "longitude_deg."
        )
    elif away > FASTEST * duration:
        remarks.append(
            f"the first waypoint is {away:.4g} m away, too far for {duration:g} s: "
            "check its place, the glider's (initial_state) and clock.duration_s."
        )
    return tuple(remarks)


def vehicle_remarks(
    vehicle: VehicleData, plant: str, actuators: Command[Any]
) -> tuple[str, ...]:
    """Remarks on actuators beyond their vehicle's file, and on a plant that is not its.

    Args:
        vehicle: vehicle of the mission.
        plant: name of the plant.
        actuators: actuators of the mission.
    """
    remarks = []
    if plant == "printed" and vehicle.name != "SeaWing":
        remarks.append(
            f'vehicle.plant is "printed", the paper\'s equations for SeaWing, in which '
            f"a glider rolls away from its moving mass: for {vehicle.name} take "
            '"rigid-body" or "seawing".'
        )
    for name, unit in COMMAND_UNITS.items():
        limit = float(getattr(actuators, name).limit)
        own = float(getattr(vehicle.limits, name))
        if limit > 1.001 * own:
            remarks.append(
                f"actuators.{name}.limit_{unit} is {limit:.4g}, beyond the "
                f"{own:.4g} {unit} that the file of {vehicle.name} says it reaches. "
                "Leave the key out to take that."
            )
        rate = getattr(getattr(actuators, name), "rate_limit", None)
        most = vehicle.rates and float(getattr(vehicle.rates, name))
        if rate is not None and most and float(rate) > 1.001 * most:
            remarks.append(
                f"actuators.{name}.rate_limit_{unit}_s is {float(rate):.4g}, beyond "
                f"the {most:.4g} {unit}/s of the file of {vehicle.name}."
            )
    return tuple(remarks)


def stand_ins(data: dict[str, Any]) -> str:
    """Sentences on what is the paper's or the vehicle's in a mission.

    Args:
        data: tables of the mission, which have been read without a complaint.
    """
    missing = [name for name in _OF_THE_PAPER if "." not in name and name not in data]
    reference = data.get("reference", {"schedule": None})
    if "schedule" not in reference and reference.get("type") != "yo":
        missing.append("reference.schedule")
    plant = data.get("vehicle", {}).get("plant", "printed")
    rates = ""
    if "actuators" not in data and paper.default_actuators(plant) == "vehicle":
        rates = "the actuators move as fast as the vehicle's file says."
    if not missing:
        return rates
    words = "; ".join(f"{name}: {_OF_THE_PAPER[name]}" for name in missing)
    said = f"tables that the mission leaves out are the paper's ({words})."
    return f"{said} {rates}".strip()


def _listed(values: Any) -> list[float]:
    return [float(x) for x in (values if isinstance(values, list) else [values])]


def _beside_the_leg(path: dict[str, Any], place: tuple[float, float]) -> list[str]:
    """A glider that starts elsewhere than the first leg, which nobody has placed."""
    keys = ("start_north_m", "start_east_m")
    if all(at == 0.0 or key in path for key, at in zip(keys, place, strict=True)):
        return []
    leg = [float(path.get(key, 0.0)) for key in keys]
    return [
        f"the glider starts at ({place[0]:.10g}, {place[1]:.10g}) m, but the first leg "
        f"at ({leg[0]:.10g}, {leg[1]:.10g}), by default: it must join the leg from the "
        "side, with a large heading error. For a leg from where it is, give "
        f"reference.waypoints start_north_m = {place[0]:.10g} and start_east_m = "
        f"{place[1]:.10g}."
    ]


def _like_decimal_degrees(north: list[float], east: list[float]) -> bool:
    """Whether all are latitudes and longitudes given to four decimals or more.

    A tenth of a millimetre is no place that anybody means in metres.
    """
    fine = all(abs(x - round(x, 3)) > 1e-9 for x in (*north, *east))
    ranges = max(map(abs, north)) <= 90.0 and max(map(abs, east)) <= 180.0
    return fine and ranges


def _like_degrees_and_minutes(north: list[float], east: list[float]) -> bool:
    """Whether all are below 180 degrees with less than 60 minutes, and far from here.

    Places that are metres may look the same by chance; then they are no such cluster
    far from the point that they count from, or round.
    """
    values = [abs(x) for x in (*north, *east)]
    shaped = all(x < 18100.0 and x % 100.0 < 60.0 for x in values)
    round_ones = all(x == round(x) for x in values)
    extent = math.hypot(max(north) - min(north), max(east) - min(east))
    far = math.hypot(north[0], east[0]) > max(10.0 * extent, 100.0)
    return shaped and far and not round_ones
