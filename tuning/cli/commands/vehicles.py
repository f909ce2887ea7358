"""The commands that list what comes with the package: vehicles and missions."""

import argparse
import json
import math
import sys
from typing import Any

from jaxglider.files.flight.missions import mission_path, mission_summaries
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.published import load_vehicle, vehicle_names, vehicle_text
from tuning.reporting.exit_codes import OK


def vehicles(options: argparse.Namespace) -> int:
    """`jaxglider vehicles`: the vehicles of the package, or the file of one."""
    if options.show is not None:
        sys.stdout.write(vehicle_text(options.show))
        return OK
    found = {name: _summary(load_vehicle(name)) for name in vehicle_names()}
    if options.json:
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
        return OK
    lines = [
        f"{'vehicle':<10}{'mass [kg]':>11}{'m_b [kg]':>10}{'r_p1 [m]':>10}"
        f"{'gamma [deg]':>13}{'doubts':>8}  plants"
    ]
    for name, one in found.items():
        lines.append(
            f"{name:<10}{one['displaced_mass_kg']:>11.2f}"
            f"{one['buoyancy_mass_limit_kg']:>10g}{one['mass_position_limit_m']:>10g}"
            f"{one['mass_angle_limit_deg']:>13.0f}{len(one['doubts']):>8}  "
            + ", ".join(one["plants"])
        )
    lines += ["", "`jaxglider vehicles --show NAME` prints sources and doubts; a copy"]
    lines += ["of that file, edited, is a vehicle of your own: --vehicle FILE.toml."]
    sys.stdout.write("\n".join(lines) + "\n")
    return OK


def _summary(vehicle: VehicleData) -> dict[str, Any]:
    limits, body = vehicle.limits, vehicle.body
    mass = None if body is None else float(body.displaced_mass(vehicle.parameters))
    return {
        "name": vehicle.name,
        "displaced_mass_kg": mass,
        "buoyancy_mass_limit_kg": float(limits.buoyancy_mass),
        "mass_position_limit_m": float(limits.mass_position),
        "mass_angle_limit_deg": math.degrees(float(limits.mass_angle)),
        "plants": ["printed", "rigid-body", *([] if body is None else ["seawing"])],
        "doubts": dict(vehicle.doubts),
    }


_HINT = """`jaxglider simulate NAME` flies one; --mission NAME stands wherever --config
does; `jaxglider missions --show NAME` prints its file, to start one of your own."""


def missions(options: argparse.Namespace) -> int:
    """`jaxglider missions`: the missions of the package, or the file of one.

    Raises:
        ValueError: there is none of that name.
    """
    if options.show is not None:
        sys.stdout.write(mission_path(options.show).read_text(encoding="utf-8"))
        return OK
    found = mission_summaries()
    if options.json:
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
        return OK
    wide = max(len(name) for name in found) + 2
    lines = [f"{'mission':<{wide}}{'vehicle':<15}{'law':<13}{'at most':<9}about"]
    for name, one in found.items():
        lines.append(
            f"{name:<{wide}}{one['vehicle']:<15}{one['controller']:<13}"
            f"{one['at_most']:<9}{one['about']}"
        )
    sys.stdout.write("\n".join(lines) + f"\n\n{_HINT}\n")
    return OK
