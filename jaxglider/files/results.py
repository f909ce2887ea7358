"""Results on disk: trajectories as NetCDF, metrics as JSON, and where they came from.

Every file is written under a temporary name and renamed, so a reader never sees half of
one.
"""

import json
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import equinox as eqx
import netCDF4
import numpy as np

from jaxglider.files.flight.flight_variables import (
    FLIGHT_UNITS,
    energy_variables,
    write_flights,
)
from jaxglider.files.writing import replacing
from jaxglider.guidance.phases import STATUSES
from jaxglider.navigation.errors import NavigationMetrics
from jaxglider.signals import CHANNEL_UNITS, COMMAND_UNITS
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.origin import MAP_ZERO, Origin
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

_STATE = {
    "north": ("m", "position north"),
    "east": ("m", "position east"),
    "depth": ("m", "depth below the surface"),
    "roll": ("rad", "roll angle"),
    "pitch": ("rad", "pitch angle, nose up"),
    "heading": ("rad", "heading, clockwise from north, not wrapped"),
    "surge": ("m s-1", "velocity forward, body frame"),
    "sway": ("m s-1", "velocity to starboard, body frame"),
    "heave": ("m s-1", "velocity downward, body frame"),
    "roll_rate": ("rad s-1", "roll rate, body frame"),
    "pitch_rate": ("rad s-1", "pitch rate, body frame"),
    "yaw_rate": ("rad s-1", "yaw rate, body frame"),
}
_STANDARD_NAMES = {
    "depth": "depth",
    "roll": "platform_roll_starboard_down",
    "pitch": "platform_pitch_fore_up",
    "heading": "platform_yaw_fore_starboard",
    "surge": "platform_surge_rate_fore",
    "sway": "platform_sway_rate_starboard",
    "heave": "platform_heave_rate_down",
    "roll_rate": "platform_roll_rate_starboard_down",
    "pitch_rate": "platform_pitch_rate_fore_up",
    "yaw_rate": "platform_yaw_rate_fore_starboard",
}
_EPOCH = "2000-01-01T00:00:00Z"


def metrics_dict(metrics: Metrics, *, has_waypoints: bool) -> dict[str, Any]:
    """Metrics as plain numbers; what is not finite becomes None.

    So do the measures of a run that was over before its first tick: its zeros would
    read as perfect.

    Args:
        metrics: metrics of one run.
        has_waypoints: flag, the reference was a waypoint path.
    """
    channels = {
        name: {key: json_number(value) for key, value in vars(channel).items()}
        for name, channel in vars(metrics.channels).items()
    }
    if not metrics.end_time > 0.0:
        channels = {name: dict.fromkeys(of) for name, of in channels.items()}
    return {
        "end_time_s": json_number(metrics.end_time),
        "finite": bool(metrics.finite),
        "capsized": bool(metrics.capsized),
        "max_roll_rad": json_number(metrics.max_roll),
        "max_pitch_rad": json_number(metrics.max_pitch),
        "waypoints_reached": int(metrics.waypoints_reached) if has_waypoints else None,
        "channels": channels,
        **_flight(metrics),
    }


def _flight(metrics: Metrics) -> dict[str, Any]:
    """The end of the mission and the measures of the flight, where there are any."""
    told: dict[str, Any] = {}
    if metrics.status is not None:
        told["status"] = STATUSES[int(metrics.status)]
    if metrics.navigation is not None:
        told["navigation"] = _navigation(metrics.navigation)
    if metrics.flight is not None:
        told["flight"] = {
            f"{name}_{FLIGHT_UNITS[name]}" if name in FLIGHT_UNITS else name: (
                {key: json_number(number) for key, number in vars(value).items()}
                if isinstance(value, eqx.Module)
                else json_number(value)
            )
            for name, value in vars(metrics.flight).items()
        }
    return told


def _navigation(metrics: NavigationMetrics) -> dict[str, Any]:
    """The errors of what is known on board, keys with their units."""
    told: dict[str, Any] = {}
    for name, value in vars(metrics).items():
        if isinstance(value, eqx.Module):
            told[f"{name}_rms"] = {
                f"{key}_{NAVIGATION_UNITS[key]}": json_number(number)
                for key, number in vars(value).items()
            }
        else:
            unit = NAVIGATION_UNITS.get(name)
            told[f"{name}_{unit}" if unit else name] = json_number(value)
    return told


NAVIGATION_UNITS = {
    **dict.fromkeys(("depth", "miss"), "m"),
    **dict.fromkeys(("depth_rate", "surge", "sway", "heave", "current_error"), "m_s"),
    **dict.fromkeys(("pitch", "heading"), "rad"),
    **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad_s"),
}
"""Units at the end of the keys of the errors of navigation."""


def json_number(value: Any) -> Any:
    """A number as JSON has it, None where it is not finite; anything else as it is."""
    if isinstance(value, str):
        return value
    number = float(value)
    return number if np.isfinite(number) else None


def write_head(file: Any, title: str, about: dict[str, Any]) -> None:
    """Write the attributes of a NetCDF file as a whole.

    Args:
        file: open file.
        title: title of the file.
        about: provenance, kept as a JSON attribute.
    """
    file.Conventions = "CF-1.8 CF-1.9 CF-1.10 CF-1.11"
    file.title = title
    file.source = "jaxglider"
    file.history = f"{about.get('created', '')} jaxglider"
    file.provenance = json.dumps(about)


def write_trajectories(
    path: str | Path,
    runs: dict[str, Trajectory],
    about: dict[str, Any],
    origin: Origin = MAP_ZERO,
) -> None:
    """Write trajectories as NetCDF-4 with CF attributes, dimensions run and time.

    Positions are in a plane that lies nowhere on Earth, so that a run is no trajectory
    in the sense of these conventions, which ask for latitude and longitude.

    Runs of different length are padded with the fill value, and so are the ticks after
    a mission has ended. Flights of yos have their phases, their measures and those of
    each dive and climb besides.

    Args:
        path: path of the file.
        runs: trajectories by label; all with the same tick.
        about: provenance, kept as a JSON attribute.
        origin: place that the positions of the runs count from; those in the file are
            true ones.

    Raises:
        OSError: the file cannot be written.
    """
    runs = {label: origin.on_the_map(run) for label, run in runs.items()}
    length = max(run.ticks.time.shape[0] for run in runs.values())
    longest = max(runs.values(), key=lambda run: run.ticks.time.shape[0])
    with (
        replacing(path) as temporary,
        netCDF4.Dataset(temporary, "w", format="NETCDF4") as file,
    ):
        write_head(file, "Closed-loop runs of an underwater glider", about)
        file.createDimension("run", len(runs))
        file.createDimension("time", length)
        # No coordinate variable, which may hold numbers only: a name of its own.
        label = file.createVariable("run_name", str, ("run",))
        label.long_name = "scenario/plant/controller"
        label[:] = np.asarray(list(runs), dtype=object)
        time = file.createVariable("time", "f8", ("time",))
        time.units, time.calendar = f"seconds since {_EPOCH}", "standard"
        time.units_metadata = "leap_seconds: none"
        time.standard_name, time.axis = "time", "T"
        time.long_name = "start of the control tick"
        time.comment = f"a simulation has no date: {_EPOCH} stands for its start"
        time[:] = np.asarray(longest.ticks.time)
        known = all(run.ticks.onboard is not None for run in runs.values())
        counted = all(run.ticks.energy is not None for run in runs.values())
        for name, units, text, where in variables(known, counted):
            columns = [column(run.ticks, where) for run in runs.values()]
            _write_variable(file, name, units, text, columns)
        write_flights(file, list(runs.values()))


def _write_variable(
    file: Any, name: str, units: str, text: str, columns: list[Any]
) -> None:
    kind = "f8" if np.asarray(columns[0]).dtype == np.float64 else "f4"
    variable = file.createVariable(
        name, kind, ("run", "time"), zlib=True, complevel=1, fill_value=np.nan
    )
    variable.units, variable.long_name = units, text
    variable.coordinates = "run_name"
    if name in _STANDARD_NAMES:
        variable.standard_name = _STANDARD_NAMES[name]
    if name == "depth":
        variable.positive = "down"
    for row, values in enumerate(columns):
        variable[row, : len(values)] = np.asarray(values)


def variables(
    onboard: bool = False, energy: bool = False
) -> Iterator[tuple[str, str, str, str]]:
    """Name, unit, description and path in a tick of each variable in the file.

    Args:
        onboard: flag, what is known on board was recorded.
        energy: flag, energy was counted.
    """
    for name, (units, text) in _STATE.items():
        yield name, units, text, f"state.{name}"
    for name, units in CHANNEL_UNITS.items():
        yield f"{name}_reference", units, f"{name}: reference", f"reference.{name}"
        yield f"{name}_error", units, f"{name}: tracking error", f"error.{name}"
        for edge in ("lower", "upper"):
            text = f"{name}: {edge} edge of the specified funnel"
            yield f"{name}_{edge}_bound", units, text, f"limits.{name}.{edge}"
            text = f"{name}: {edge} edge of the law's own funnel"
            yield f"{name}_{edge}_law_bound", units, text, f"law_limits.{name}.{edge}"
    for name, units in COMMAND_UNITS.items():
        for kind in ("wanted", "applied"):
            text = f"{name.replace('_', ' ')}, {kind}"
            yield f"{name}_{kind}", units, text, f"{kind}.{name}"
    disturbances = {
        "estimate": "estimate of the lumped disturbance",
        "lumped": "lumped disturbance, mean over the tick",
        "disturbance": "external disturbance",
    }
    for name in ("surge", "sway", "heave", "roll", "pitch", "yaw"):
        units = "N" if name in ("surge", "sway", "heave") else "N m"
        for kind, text in disturbances.items():
            yield (
                f"{name}_{kind}",
                units,
                f"{name}: {text}, body frame",
                f"{kind}.{name}",
            )
    if onboard:
        for name, (units, text) in _STATE.items():
            yield (
                f"{name}_estimated",
                units,
                f"{text}, as known on board",
                f"onboard.estimate.{name}",
            )
        for name in ("depth", "roll", "pitch", "heading"):
            text = f"{name} as its sensor shows it"
            yield f"{name}_shown", _STATE[name][0], text, f"onboard.shown.{name}"
        for number, name in enumerate(("north", "east")):
            text = f"velocity {name} of the water that is reckoned with"
            yield f"current_{name}", "m s-1", text, f"onboard.current.{number}"
            text = f"fix {name} by satellite"
            yield f"fix_{name}", "m", text, f"onboard.fix.{number}"
    if energy:
        yield from energy_variables()
    yield "target", "1", "waypoint or segment being followed", "target"
    yield "clock", "s", "time since the funnel was restarted", "clock"


def column(ticks: TickRecord, path: str) -> np.ndarray:
    """Values of one variable, NaN in the ticks after the end of the mission.

    Args:
        ticks: records of a run, on the host.
        path: path of the variable in a record.
    """
    place, _, number = path.rpartition(".")
    if number.isdigit():
        values = np.asarray(attrgetter(place)(ticks)[int(number)])
    else:
        values = np.asarray(attrgetter(path)(ticks))
    return np.where(np.asarray(ticks.active), values, np.nan)
