"""Tables of an uncertainty file about actuators: how slow they are, how they fail."""

import dataclasses
from typing import Any

from jaxglider._laws import read_law
from jaxglider._toml import ConfigError, Table, choice
from jaxglider.distributions import AbstractDistribution, Sometimes
from jaxglider.scenario import Scenario
from jaxglider.signals import Command
from jaxglider.uncertainty import Quantity
from jaxglider.vehicle.actuators import NEVER, Failure

ACTUATORS = tuple(field.name for field in dataclasses.fields(Command))
Found = tuple[Scenario, list[Quantity]]


def read_lags(table: Table, scenario: Scenario) -> Found:
    """Time constants of the actuators."""
    found = []
    for name in ACTUATORS:
        own = table.table(name)
        given = own.get("time_constant_s", None)
        own.close()
        if given is None:
            continue
        where = own.where("time_constant_s")
        law = read_law(given, where)
        if law.support()[0] <= 0.0:
            raise ConfigError(f"{where} must stay positive.")
        scenario = _changed(scenario, name, time_constant=law.middle())
        path = f"actuators.{name}.time_constant"
        found.append(Quantity(f"{name}_time_constant", path, "s", law))
    return scenario, found


def read_failures(tables: list[Table], scenario: Scenario) -> Found:
    """Actuators that get stuck or weak, some or all members, at some time."""
    found: list[Quantity] = []
    for table in tables:
        name = str(table.get("actuator"))
        choice(name, dict.fromkeys(ACTUATORS), table.where("actuator"))
        kinds = {"stuck": "stuck_from", "weak": "weak_from"}
        kind = choice(table.get("kind"), kinds, table.where("kind"))
        time = read_law(table.get("time_s"), table.where("time_s"))
        if time.support()[0] < 0.0:
            raise ConfigError(f"{table.where('time_s')} must not be negative.")
        share = table.number("probability", 1.0)
        try:
            when = Sometimes(share, time, NEVER)
        except ValueError as error:
            where = table.where("probability")
            raise ConfigError(f"{where}: {error}") from error
        if getattr(scenario.actuators, name).failure is None:
            scenario = _changed(scenario, name, failure=Failure())
        found.append(_failure(name, kind, "s", when))
        if kind == "weak_from":
            where = table.where("effectiveness")
            law = read_law(table.get("effectiveness"), where)
            low, high = law.support()
            if low < 0.0 or high > 1.0:
                raise ConfigError(f"{where} must stay in [0, 1].")
            found.append(_failure(name, "effectiveness", "1", law))
        table.close()
    return scenario, found


def _failure(name: str, field: str, unit: str, law: AbstractDistribution) -> Quantity:
    return Quantity(f"{name}_{field}", f"actuators.{name}.failure.{field}", unit, law)


def _changed(scenario: Scenario, name: str, **changes: Any) -> Scenario:
    changed = dataclasses.replace(getattr(scenario.actuators, name), **changes)
    actuators = dataclasses.replace(scenario.actuators, **{name: changed})
    return dataclasses.replace(scenario, actuators=actuators)
