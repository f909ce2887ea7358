"""Uncertainty as TOML: tables turned into quantities of a scenario.

Each function reads one table, refuses what it does not know, and names the key in every
complaint. `TEMPLATE` is a complete, commented file.
"""

import dataclasses
import difflib
import functools
import math
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError, TomlTable, number, read_toml
from jaxglider.environment.disturbances import ScaledDisturbance, Sum
from jaxglider.files.file_kinds import refuse_other_kind
from jaxglider.files.flight.start_tables import STATE_UNITS
from jaxglider.files.mission_tables import read_disturbance
from jaxglider.files.uncertainty_tables import (
    Additions,
    read_distribution,
    read_failures,
    read_lags,
)
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.distributions import AbstractDistribution
from jaxglider.uncertainty.members import Group, Quantity, Uncertainty
from jaxglider.uncertainty.quantities import relative, start, waves
from jaxglider.vehicle.parameters import UNCERTAIN, GliderParameters
from jaxglider.vehicle.sensors import Sensor

TEMPLATE = functools.partial(
    (resources.files("jaxglider.files") / "templates" / "uncertainty.toml").read_text,
    encoding="utf-8",
)
"""Call it for the text of a complete, commented uncertainty file."""

_INERTIA = tuple(n for n in UNCERTAIN if n.endswith(("_mass", "_inertia")))
PARAMETERS = {
    "all": UNCERTAIN,
    "inertia": _INERTIA,
    "hydrodynamics": tuple(n for n in UNCERTAIN if n not in _INERTIA),
}
"""Names that stand for several parameters."""


def load_uncertainty(path: str | Path, scenario: Scenario) -> Uncertainty:
    """Read an uncertainty file.

    Args:
        path: path of the file.
        scenario: the nominal one.

    Raises:
        ConfigError: names the file, the key, the rule and the value.
    """
    try:
        return build_uncertainty(read_toml(path), scenario)
    except ConfigError as error:
        text = str(error)
        named = text.startswith(f"{path}: ")
        raise ConfigError(text if named else f"{path}: {text}") from error


def build_uncertainty(data: dict[str, Any], scenario: Scenario) -> Uncertainty:
    """The uncertainty of a scenario from parsed TOML.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    refuse_other_kind(data, "uncertainty")
    top = TomlTable(data, "")
    try:
        quantities, groups = _vehicle(top.tables("vehicle"), scenario)
        for key, read in (
            ("disturbance", _disturbance),
            ("initial_state", _initial_state),
            ("sensors", _sensors),
            ("actuators", read_lags),
        ):
            table = top.table(key)
            scenario, more = read(table, scenario)
            table.close()
            quantities += more
        scenario, more = read_failures(top.tables("failure"), scenario)
        top.close()
        uncertainty = Uncertainty(scenario, (*quantities, *more), groups)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if not uncertainty.quantities and not uncertainty.has_chance():
        raise ConfigError("nothing is uncertain; `jaxglider init` writes an example.")
    return uncertainty


def _vehicle(
    tables: list[TomlTable], scenario: Scenario
) -> tuple[list[Quantity], tuple[Group, ...]]:
    """Factors on parameters of the glider."""
    quantities: list[Quantity] = []
    groups: list[Group] = []
    for count, table in enumerate(tables, 1):
        names = _parameters(table.get("names", "all"), table.where("names"))
        correlation = table.get("correlation", None)
        where = table.where("")[:-1]
        factors = _factors(table.rest(), names, where)
        try:
            quantities += [
                relative(scenario, name, factor)
                for name, factor in zip(names, factors, strict=True)
            ]
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from error
        if correlation is not None:
            matrix = _correlation(correlation, len(names), f"{where}.correlation")
            groups.append(Group(f"group{count}", names, matrix))
    return quantities, tuple(groups)


def _factors(
    table: dict[str, Any], names: tuple[str, ...], where: str
) -> list[AbstractDistribution]:
    """One distribution for all the names, or one each by a list of deviations."""
    deviation = table.get("standard_deviation")
    if not isinstance(deviation, list):
        return [read_distribution(table, where, 1.0)] * len(names)
    if len(deviation) != len(names):
        raise ConfigError(
            f"{where}.standard_deviation must be one number or a list of "
            f"{len(names)}, one for each name; received {deviation!r}."
        )
    return [
        read_distribution({**table, "standard_deviation": one}, where, 1.0)
        for one in deviation
    ]


def _parameters(value: Any, where: str) -> tuple[str, ...]:
    """The parameters that a word, or a list of words, stands for.

    Raises:
        ConfigError: there are none, or there is no such parameter.
    """
    words = value if isinstance(value, list) else [value]
    known = [*PARAMETERS, *(f.name for f in dataclasses.fields(GliderParameters))]
    if not words:
        raise ConfigError(f"{where} must name at least 1 parameter; received [].")
    for word in words:
        if word not in known:
            near = difflib.get_close_matches(str(word), known, 1)
            hint = f"Did you mean {near[0]}?" if near else f"Use {', '.join(known)}."
            raise ConfigError(f"{where}: {word!r} is no parameter. {hint}")
    return tuple(name for word in words for name in PARAMETERS.get(word, (word,)))


def _correlation(value: Any, size: int, where: str) -> tuple[tuple[float, ...], ...]:
    """One number for all pairs, or the whole matrix."""
    if isinstance(value, list):
        lists = all(isinstance(row, list) for row in value)
        if not lists or [len(row) for row in value] != [size] * size:
            raise ConfigError(
                f"{where} must be one number or a list of {size} lists of {size} "
                f"numbers each; received {value!r}."
            )
        return tuple(tuple(number(x, where) for x in row) for row in value)
    common = number(value, where)
    matrix = np.full((size, size), common)
    np.fill_diagonal(matrix, 1.0)
    return tuple(tuple(row) for row in matrix.tolist())


def _disturbance(table: TomlTable, scenario: Scenario) -> Additions:
    """The waves' amplitudes and phases, then noise, strength and direction on top."""
    degrees = math.pi / 180.0
    noise = table.get("coloured_noise", None)
    if noise is not None:
        entry = TomlTable(
            {"type": "coloured-noise", **table.table("coloured_noise").rest()},
            table.where("coloured_noise"),
        )
        total = Sum((scenario.disturbance, read_disturbance([entry])))
        scenario = dataclasses.replace(scenario, disturbance=total)
    varied = {"strength": 1.0, "direction_deg": 0.0}
    if any(table.get(key, None) is not None for key in varied):
        whole = ScaledDisturbance(scenario.disturbance)
        scenario = dataclasses.replace(scenario, disturbance=whole)
    distributions = {
        key: read_distribution(table.get(key), table.where(key), centre, unit)
        for key, centre, unit in (
            ("amplitude", 1.0, 1.0),
            ("phase_deg", 0.0, degrees),
            ("strength", 1.0, 1.0),
            ("direction_deg", 0.0, degrees),
        )
        if table.get(key, None) is not None
    }
    keys = {"amplitude", "phase_deg"} & set(distributions)
    quantities = waves(
        scenario, distributions.get("amplitude"), distributions.get("phase_deg")
    )
    if keys and not quantities:
        raise ConfigError(
            f"{table.where(min(keys))}: the disturbance of this scenario has no "
            "sinusoid; remove the key."
        )
    for key, unit in (("strength", "1"), ("direction_deg", "rad")):
        if key in distributions:
            name = key.removesuffix("_deg")
            path = f"disturbance.{name}"
            quantities.append(
                Quantity(f"disturbance_{name}", path, unit, distributions[key])
            )
    return scenario, quantities


def _initial_state(table: TomlTable, scenario: Scenario) -> Additions:
    """Offsets of the start."""
    quantities = []
    for name, (unit, scale) in STATE_UNITS.items():
        key = f"{name}_{unit}"
        value = table.get(key, None)
        if value is None:
            continue
        nominal = float(getattr(scenario.initial_state, name))
        offset = read_distribution(value, table.where(key), 0.0, scale)
        reach = max(abs(nominal + end) for end in offset.support())
        if name == "pitch" and reach >= math.pi / 2:
            raise ConfigError(f"{table.where(key)}: the pitch must stay within 90 deg.")
        quantities.append(start(scenario, name, SI[unit], offset))
    return scenario, quantities


SI = {"m": "m", "deg": "rad", "m_s": "m s-1", "deg_s": "rad s-1"}
"""Units of values whose keys end so."""


def _sensors(table: TomlTable, scenario: Scenario) -> Additions:
    """Noise, and bias known or uncertain."""
    sensors, quantities = {}, []
    for name, (unit, scale) in STATE_UNITS.items():
        if table.get(name, None) is None:
            continue
        own = table.table(name)
        noise = scale * own.number(f"noise_{unit}", 0.0)
        bias = own.get(f"bias_{unit}", 0.0)
        distribution = read_distribution(bias, own.where(f"bias_{unit}"), 0.0, scale)
        own.close()
        try:
            sensors[name] = Sensor(distribution.middle(), noise)
        except ValueError as error:
            raise ConfigError(f"{table.where(name)}: {error}") from error
        if isinstance(bias, dict):
            path = f"sensors.{name}.bias"
            quantities.append(
                Quantity(f"sensor_bias_{name}", path, SI[unit], distribution)
            )
    if sensors:
        scenario = dataclasses.replace(scenario, sensors=sensors)
    return scenario, quantities
