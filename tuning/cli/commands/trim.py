"""The command that finds steady motions and says what they are like."""

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxglider import paper
from jaxglider.core.toml import reason
from jaxglider.files.writing import provenance, write_json
from jaxglider.plotting.glide import glide_figure
from jaxglider.plotting.save import save
from jaxglider.trim.linear_model import INPUTS, linearise
from jaxglider.trim.modes import Analysis, Mode, analyse
from jaxglider.trim.steady_motion import SteadyMotion, Target, steady_motion
from jaxglider.trim.straight_glide import glide_limits
from jaxglider.vehicle.full_plant import FullPlant
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant
from jaxglider.vehicle.published import load_vehicle
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import OK, RUN_FAILED, USAGE, VIOLATED
from tuning.reporting.output_folder import folder_name


def trim(options: argparse.Namespace) -> int:
    """`jaxglider trim`: one steady motion, its modes, and the glide polar."""
    try:
        vehicle = load_vehicle(options.vehicle)
    except OSError as error:
        raise OSError(
            f"--vehicle {options.vehicle} cannot be read: {reason(error)} "
            f"({Path(options.vehicle).absolute()}). `jaxglider vehicles` lists those "
            "there are, and --show NAME prints a file to start from."
        ) from error
    plant = paper.PLANTS[options.plant](vehicle)
    target = _target(options, vehicle)
    why = _impossible(plant, target)
    if why:
        note(why)
        return USAGE
    progress = Progress()
    progress.show("looking for the steady motion ...")
    motion = jax.jit(steady_motion)(plant, target)
    if not bool(motion.converged):
        progress.clear()
        note(
            "no steady upright motion found for this: the glide angle may be too "
            "shallow or the turn too tight for the glider."
        )
        return RUN_FAILED
    progress.show("linearising ...")
    linear = jax.jit(linearise)(plant, motion)
    limits = np.array([float(getattr(vehicle.limits, name)) for name in INPUTS])
    analysis = analyse(np.asarray(linear.a), np.asarray(linear.b), limits)
    progress.clear()
    beyond = _beyond(motion, vehicle)
    result = {
        "vehicle": vehicle.name,
        "plant": options.plant,
        "motion": motion_dict(motion),
        "beyond_limits": beyond,
        "analysis": _analysis_dict(analysis),
        "shallowest_glide_deg": _limits_dict(plant),
        "provenance": provenance(command=sys.argv[1:], precision=options.precision),
    }
    print_result(result, _text(result), as_json=options.json)
    write_json(options.out / "trim.json", result)
    drawn = glide_figure(vehicle, plant, motion, analysis, options.plant)
    figure = save(drawn, options.out / "trim.png")
    note(f"{folder_name(options.out)}: trim.json and {figure.name}.")
    for name in beyond:
        note(f"{name} is beyond the actuator's limit: the vehicle cannot hold this.")
    return VIOLATED if beyond else OK


def _target(options: argparse.Namespace, vehicle: VehicleData) -> Target:
    """The target of the options; else 3/4 of the buoyancy, straight, forward."""
    given: dict[str, float] = {
        name: value
        for name in ("buoyancy_mass", "speed", "mass_position", "turn_radius")
        if (value := getattr(options, name)) is not None
    }
    for name in ("glide_angle", "mass_angle", "turn_rate"):
        value = getattr(options, name)
        if value is not None:
            given[name] = math.radians(value)
    if not {"buoyancy_mass", "speed"} & set(given):
        sign = -1.0 if given.get("glide_angle", -1.0) > 0.0 else 1.0
        given["buoyancy_mass"] = sign * 0.75 * float(vehicle.limits.buoyancy_mass)
    if not {"mass_position", "glide_angle"} & set(given):
        sign = -1.0 if given.get("buoyancy_mass", 1.0) < 0.0 else 1.0
        given["mass_position"] = sign * float(vehicle.limits.mass_position) / 3.0
    if not {"mass_angle", "turn_rate", "turn_radius"} & set(given):
        given["mass_angle"] = 0.0
    return Target(**given)


def _impossible(plant: AbstractPlant, target: Target) -> str:
    """Why there can be no such motion; nothing if there may be."""
    mass, angle = target.buoyancy_mass, target.glide_angle
    if mass is not None and float(mass) == 0.0:
        return "no steady glide without buoyancy: --buoyancy-mass must not be 0."
    if angle is None:
        return ""
    wanted = math.degrees(float(angle))
    if mass is not None and float(mass) * wanted >= 0.0:
        return (
            f"no steady glide at {wanted:g} deg with a buoyancy mass of "
            f"{float(mass):g} kg: a dive has a negative angle and a positive mass, "
            "a climb the opposite."
        )
    if isinstance(plant, FullPlant):
        dive, climb = (math.degrees(float(x)) for x in jax.jit(glide_limits)(plant))
        if dive < wanted < climb:
            return (
                f"no steady glide at {wanted:g} deg: the shallowest dive of this "
                f"glider is {dive:.2f} deg, its shallowest climb {climb:.2f} deg."
            )
    return ""


def _beyond(motion: SteadyMotion, vehicle: VehicleData) -> list[str]:
    """Names of the commands that exceed their limits."""
    return [
        name
        for name in INPUTS
        if abs(float(getattr(motion.command, name)))
        > float(getattr(vehicle.limits, name)) * (1.0 + 1e-6)
    ]


def motion_dict(motion: SteadyMotion) -> dict[str, Any]:
    """A steady motion in plain numbers, angles in degrees."""
    s, c = motion.state, motion.command
    straight = abs(float(motion.turn_rate)) < 1e-9
    return {
        "speed_m_s": float(motion.speed()),
        "glide_angle_deg": math.degrees(float(motion.glide_angle())),
        "angle_of_attack_deg": math.degrees(float(motion.angle_of_attack())),
        "sideslip_deg": math.degrees(float(motion.sideslip())),
        "pitch_deg": math.degrees(float(s.pitch)),
        "roll_deg": math.degrees(float(s.roll)),
        "turn_rate_rad_s": 0.0 if straight else float(motion.turn_rate),
        "turn_radius_m": None if straight else float(motion.turn_radius()),
        "sink_rate_m_s": float(motion.sink_rate()),
        "horizontal_speed_m_s": float(motion.horizontal_speed()),
        "buoyancy_mass_kg": float(c.buoyancy_mass),
        "mass_position_m": float(c.mass_position),
        "mass_angle_deg": math.degrees(float(c.mass_angle)),
        "residual": float(motion.residual),
    }


def _analysis_dict(analysis: Analysis) -> dict[str, Any]:
    return {
        "stable": analysis.stable(),
        "controllable": analysis.rank == analysis.order,
        "rank": analysis.rank,
        "order": analysis.order,
        "modes": [_mode_dict(mode) for mode in analysis.modes],
    }


def _mode_dict(mode: Mode) -> dict[str, Any]:
    return {
        "real_1_s": mode.eigenvalue.real,
        "imaginary_rad_s": mode.eigenvalue.imag,
        "time_constant_s": mode.time_constant(),
        "period_s": mode.period(),
        "lateral_share": mode.lateral,
        "reach": dict(zip(INPUTS, mode.reach, strict=True)),
        "distance_from_uncontrollable": mode.distance,
    }


def _limits_dict(plant: AbstractPlant) -> dict[str, float] | None:
    if not isinstance(plant, FullPlant):
        return None
    dive, climb = jax.jit(glide_limits)(plant)
    return {"dive": math.degrees(float(dive)), "climb": math.degrees(float(climb))}


def _text(result: dict[str, Any]) -> str:
    """The result for a terminal."""
    motion, analysis = result["motion"], result["analysis"]
    kind = "glide" if motion["turn_radius_m"] is None else "spiral"
    lines = [f"{result['vehicle']}, {result['plant']} plant: steady {kind}", ""]
    for key, value in motion.items():
        if key == "residual":
            continue
        name = _worded(key)
        beyond = any(key.startswith(n) for n in result["beyond_limits"])
        mark = "  beyond its limit" if beyond else ""
        shown = "straight" if value is None else f"{value:.5g}"
        lines.append(f"  {name:<26}{shown:>12}{mark}")
    shallow = result["shallowest_glide_deg"]
    if shallow is not None:
        both = f"{shallow['dive']:.2f} and {shallow['climb']:+.2f} deg"
        lines.append(f"  shallowest glides: {both}")
    stable = "stable" if analysis["stable"] else "UNSTABLE"
    lines += [
        "",
        f"  {stable}, rank of controllability {analysis['rank']} of "
        f"{analysis['order']}; how fast each actuator's full stroke sets a mode off:",
        f"  {'eigenvalue [1/s]':<22}{'lateral':>9}{'m_b':>10}{'r_p1':>10}{'gamma':>10}",
    ]
    for mode in analysis["modes"]:
        value = f"{mode['real_1_s']:.4f}"
        if mode["imaginary_rad_s"]:
            value += f" ± {mode['imaginary_rad_s']:.4f} i"
        reach = "".join(f"{x:>10.3f}" for x in mode["reach"].values())
        lines.append(f"  {value:<22}{mode['lateral_share']:>9.2f}{reach}")
    return "\n".join(lines)


def _worded(key: str) -> str:
    """`speed_m_s` as `speed [m/s]`."""
    for ending, unit in (
        ("_rad_s", "rad/s"),
        ("_m_s", "m/s"),
        ("_deg", "deg"),
        ("_kg", "kg"),
        ("_m", "m"),
    ):
        if key.endswith(ending):
            return f"{key.removesuffix(ending).replace('_', ' ')} [{unit}]"
    return key
