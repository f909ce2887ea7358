"""Flights of yos in a NetCDF file: phase and energy, the mission, and dive by dive."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from jaxglider.guidance.phases import PHASES, STATUSES
from jaxglider.signals import COMMAND_UNITS
from jaxglider.simulation.flight import COLUMNS, FlightMetrics, halves
from jaxglider.simulation.rollout import Trajectory
from jaxglider.vehicle.energy import Consumers

HALVES = ("dive", "climb")
"""Names of the kinds of a half by their numbers in the file."""
FLIGHT_UNITS = {
    **dict.fromkeys(("energy", "total_energy"), "J"),
    **dict.fromkeys(("energy_per_made_good", "energy_per_through_water"), "J_m"),
    **dict.fromkeys(("made_good", "through_water", "overshoot"), "m"),
    **dict.fromkeys(("dive_time", "climb_time", "surface_time"), "s"),
    **dict.fromkeys(("pitch_error", "heading_error"), "rad"),
    "depth_rate": "m_s",
    "pushed": "kg",
}
"""Units at the end of the keys of the measures of a flight."""
_CF_UNITS = {"J_m": "J m-1", "m_s": "m s-1", "m/s": "m s-1"}
_NO_FLAG = -1


def energy_variables() -> Iterator[tuple[str, str, str, str]]:
    """Name, unit, description and path in a tick of the energy by who took it."""
    for name in Consumers.__dataclass_fields__:
        text = f"energy taken so far, {name}"
        yield f"{name}_energy", "J", text, f"energy.{name}"


def write_flights(file: Any, runs: Sequence[Trajectory]) -> None:
    """Write the phases, the missions and their halves, where yos were flown.

    Variables `phase` (run, time), `status` and `flight_...` (run), and `half_...`
    (run, half), one for each measure that metrics.json has.

    Args:
        file: open file with the dimensions `run` and `time`.
        runs: trajectories, on the host; some may have flown no yos.
    """
    phases = [_phases(run) for run in runs]
    if any(phase is not None for phase in phases):
        _write_flags(file, "phase", ("run", "time"), "phase of the yo", PHASES, phases)
    if all(run.metrics.status is None for run in runs):
        return
    ends = [np.atleast_1d(_status(run)) for run in runs]
    _write_flags(file, "status", ("run",), "end of the mission", STATUSES, ends)
    flights = [run.metrics.flight for run in runs]
    for name, unit, path in _measures():
        values = [_number(flight, path) for flight in flights]
        _write(file, f"flight_{name}", ("run",), unit, f"flight: {name}", values)
    rows = [halves(run) for run in runs]
    count = max(map(len, rows), default=0)
    if count == 0:
        return
    file.createDimension("half", count)
    kinds = [np.array([HALVES.index(row["half"]) for row in of]) for of in rows]
    text = "dive or climb, with the inflection before it"
    _write_flags(file, "half_kind", ("run", "half"), text, HALVES, kinds)
    for key, unit in {"start_s": "s", **COLUMNS}.items():
        name = key.removesuffix("_" + unit.replace("/", "_"))
        columns = [[row[key] for row in of] for of in rows]
        text = f"{name.replace('_', ' ')} of a half"
        _write(file, f"half_{name}", ("run", "half"), unit, text, columns)


def _phases(run: Trajectory) -> np.ndarray | None:
    if run.ticks.phase is None:
        return None
    return np.where(np.asarray(run.ticks.active), run.ticks.phase, _NO_FLAG)


def _status(run: Trajectory) -> int:
    return _NO_FLAG if run.metrics.status is None else int(run.metrics.status)


def _measures() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Name, unit and path of each measure of a flight."""
    for name in FlightMetrics.__dataclass_fields__:
        if name == "energy":
            for consumer in Consumers.__dataclass_fields__:
                yield f"energy_{consumer}", "J", (name, consumer)
        elif name in ("moves", "travel"):
            for actuator, unit in COMMAND_UNITS.items():
                own = unit if name == "travel" else "1"
                yield f"{name}_{actuator}", own, (name, actuator)
        else:
            yield name, FLIGHT_UNITS.get(name, "1"), (name,)


def _number(flight: eqx.Module | None, path: tuple[str, ...]) -> float:
    value: Any = flight
    for name in path:
        value = None if value is None else getattr(value, name)
    return math.nan if value is None else float(value)


def _write(
    file: Any,
    name: str,
    dimensions: tuple[str, ...],
    unit: str,
    text: str,
    values: Sequence[Any],
) -> None:
    """Write numbers, a row for each run, padded with the fill value."""
    variable = file.createVariable(name, "f8", dimensions, fill_value=np.nan)
    variable.units, variable.long_name = _CF_UNITS.get(unit, unit), text
    variable.coordinates = "run_name"
    for row, numbers in enumerate(values):
        if len(dimensions) == 1:
            variable[row] = numbers
        else:
            variable[row, : len(numbers)] = numbers


def _write_flags(
    file: Any,
    name: str,
    dimensions: tuple[str, ...],
    text: str,
    meanings: Sequence[str],
    values: Sequence[np.ndarray | None],
) -> None:
    """Write numbers that stand for words, as CF has flags."""
    variable = file.createVariable(
        name, "i1", dimensions, zlib=len(dimensions) > 1, fill_value=_NO_FLAG
    )
    variable.long_name, variable.coordinates = text, "run_name"
    variable.flag_values = np.arange(len(meanings), dtype=np.int8)
    variable.flag_meanings = " ".join(word.replace(" ", "_") for word in meanings)
    for row, numbers in enumerate(values):
        if numbers is None:
            continue
        if len(dimensions) == 1:
            variable[row] = numbers[0]
        else:
            variable[row, : len(numbers)] = numbers
