"""Distributions as TOML tables.

`{law = "uniform", half_width = 0.2}`, or low and high; `{law = "normal",
standard_deviation = 0.1, truncation = 3.0}`; `{law = "log-normal", standard_deviation =
0.3}`, of the logarithm. A factor on the nominal value is centred on 1, an offset on 0;
elsewhere the table must say where the distribution lies.
"""

import dataclasses
from typing import Any

from jaxglider.core.toml import ConfigError, TomlTable, choice, number
from jaxglider.signals import Command
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.distributions import (
    AbstractDistribution,
    LogNormal,
    Mixture,
    TruncatedNormal,
    Uniform,
)
from jaxglider.uncertainty.members import Quantity
from jaxglider.vehicle.actuators import NEVER, Failure


def read_distribution(
    value: Any, where: str, centre: float | None = None, unit: float = 1.0
) -> AbstractDistribution:
    """A distribution from its table; a plain number is the one value it can take.

    Args:
        value: table or number.
        where: path of the table in the file, for messages.
        centre: centre of a distribution that does not say where it lies; None where it
            must.
        unit: factor from the file's unit to SI.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    if not isinstance(value, dict):
        constant = unit * number(value, where)
        return Uniform(constant, constant)
    table = TomlTable(value, where)
    make = choice(table.get("law"), _DISTRIBUTIONS, table.where("law"))
    try:
        distribution: AbstractDistribution = make(table, centre, unit)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error
    table.close()
    return distribution


def _uniform(table: TomlTable, centre: float | None, unit: float) -> Uniform:
    if table.get("half_width", None) is None:
        return Uniform(unit * table.number("low"), unit * table.number("high"))
    mean, width = _middle(table, "mean", centre), table.number("half_width")
    if width < 0.0:
        raise ConfigError(
            f"{table.where('half_width')} must be zero or positive; received {width:g}."
        )
    return Uniform(unit * (mean - width), unit * (mean + width))


def _normal(table: TomlTable, centre: float | None, unit: float) -> TruncatedNormal:
    mean = _middle(table, "mean", centre)
    deviation = table.number("standard_deviation")
    cut = table.number("truncation", 3.0)
    return TruncatedNormal(unit * mean, unit * deviation, cut)


def _log_normal(table: TomlTable, centre: float | None, unit: float) -> LogNormal:
    median = _middle(table, "median", centre)
    deviation = table.number("standard_deviation")
    return LogNormal(unit * median, deviation, table.number("truncation", 3.0))


def _middle(table: TomlTable, key: str, centre: float | None) -> float:
    if centre is None:
        return table.number(key)
    return table.number(key, centre)


_DISTRIBUTIONS = {"uniform": _uniform, "normal": _normal, "log-normal": _log_normal}


ACTUATORS = tuple(field.name for field in dataclasses.fields(Command))


Additions = tuple[Scenario, list[Quantity]]
"""A scenario that has what is uncertain, and the quantities."""


def read_lags(table: TomlTable, scenario: Scenario) -> Additions:
    """Time constants of the actuators."""
    quantities = []
    for name in ACTUATORS:
        own = table.table(name)
        value = own.get("time_constant_s", None)
        own.close()
        if value is None:
            continue
        where = own.where("time_constant_s")
        distribution = read_distribution(value, where)
        if distribution.support()[0] <= 0.0:
            raise ConfigError(f"{where} must stay positive.")
        scenario = _changed(scenario, name, time_constant=distribution.middle())
        path = f"actuators.{name}.time_constant"
        quantities.append(Quantity(f"{name}_time_constant", path, "s", distribution))
    return scenario, quantities


def read_failures(tables: list[TomlTable], scenario: Scenario) -> Additions:
    """Actuators that get stuck or weak, some or all members, at some time."""
    quantities: list[Quantity] = []
    for table in tables:
        name = str(table.get("actuator"))
        choice(name, dict.fromkeys(ACTUATORS), table.where("actuator"))
        kinds = {"stuck": "stuck_from", "weak": "weak_from"}
        kind = choice(table.get("kind"), kinds, table.where("kind"))
        time = read_distribution(table.get("time_s"), table.where("time_s"))
        if time.support()[0] < 0.0:
            raise ConfigError(f"{table.where('time_s')} must not be negative.")
        share = table.number("probability", 1.0)
        try:
            when = Mixture(share, time, NEVER)
        except ValueError as error:
            where = table.where("probability")
            raise ConfigError(f"{where}: {error}") from error
        if getattr(scenario.actuators, name).failure is None:
            scenario = _changed(scenario, name, failure=Failure())
        quantities.append(_failure(name, kind, "s", when))
        if kind == "weak_from":
            where = table.where("effectiveness")
            share_left = read_distribution(table.get("effectiveness"), where)
            low, high = share_left.support()
            if low < 0.0 or high > 1.0:
                raise ConfigError(f"{where} must stay in [0, 1].")
            quantities.append(_failure(name, "effectiveness", "1", share_left))
        table.close()
    return scenario, quantities


def _failure(
    name: str, field: str, unit: str, distribution: AbstractDistribution
) -> Quantity:
    return Quantity(
        f"{name}_{field}", f"actuators.{name}.failure.{field}", unit, distribution
    )


def _changed(scenario: Scenario, name: str, **changes: Any) -> Scenario:
    changed = dataclasses.replace(getattr(scenario.actuators, name), **changes)
    actuators = dataclasses.replace(scenario.actuators, **{name: changed})
    return dataclasses.replace(scenario, actuators=actuators)
