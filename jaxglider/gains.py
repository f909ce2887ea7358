"""Gains as TOML: controllers, observers and guidance to nested tables and back.

A table overrides a template: what it leaves out keeps the template's value. Keys carry
the unit of their number where it is not one of the law's own (`settling_time_s`,
`final_bound_rad`). Unknown keys are refused with their path.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx

from jaxglider import paper
from jaxglider._toml import (
    ConfigError,
    Table,
    choice,
    number,
    read_toml,
    refuse_unknown,
    whole_number,
)
from jaxglider.controllers import (
    PPC,
    SMC,
    AbstractController,
    FxTPPC,
    RollAwareFxTPPC,
)
from jaxglider.controllers.fxtppc import EXPONENTS
from jaxglider.observer import AbstractObserver, FixedTimeObserver, NoObserver
from jaxglider.performance import (
    AbstractPerformanceFunction,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.references import LineOfSight, WaypointPath
from jaxglider.rollout import ClosedLoop
from jaxglider.scenario import Scenario

FAMILIES: dict[type, dict[str, type]] = {
    AbstractController: {
        "smc": SMC,
        "ppc": PPC,
        "fxtppc": FxTPPC,
        "fxtppc-roll": RollAwareFxTPPC,
    },
    AbstractObserver: {"none": NoObserver, "fixed-time": FixedTimeObserver},
    AbstractPerformanceFunction: {
        "sech": SechFunction,
        "exponential": ExponentialFunction,
        "ppc": HalfSechFunction,
    },
}
"""Names of the members of each family, as they stand under `type`."""

_NAMED: dict[str, dict[str, Callable[..., Any]]] = {"exponents": EXPONENTS}
_LEFT_OUT = ("model",)
_CHANNEL_UNITS = {"depth": "m", "pitch": "rad", "heading": "rad"}


def encode(thing: eqx.Module, channel: str = "") -> dict[str, Any]:
    """A controller, an observer or a part of one as nested tables of plain numbers.

    Args:
        thing: what to encode; its design model is left out.
        channel: name of the enclosing channel, which some units depend on.
    """
    table: dict[str, Any] = {}
    family = _family(thing)
    if family:
        table["type"] = _name_in(family, type(thing))
    for field in _fields(thing):
        value = getattr(thing, field.name)
        if value is None:
            continue
        if field.name in _NAMED:
            table[field.name] = _name_in(_NAMED[field.name], value)
        elif isinstance(value, eqx.Module):
            table[field.name] = encode(value, field.name)
        elif isinstance(value, int):
            table[field.name] = value
        else:
            table[_key(field, channel)] = float(value)
    return table


def decode(
    template: Any, table: Any, path: str, channel: str = "", wanted: Any = object
) -> Any:
    """A copy of the template with the numbers of a table.

    Args:
        template: of the kind wanted, with the values for what the table leaves out.
        table: nested tables, as `encode` makes them.
        path: of the table in its file, for messages.
        channel: name of the enclosing channel.
        wanted: type of the field it is for; a `type` of another kind is refused.

    Raises:
        ConfigError: unknown key, wrong type, or a value the class refuses.
    """
    if not isinstance(table, dict):
        raise ConfigError(f"{path} must be a table; received {table!r}.")
    rest = dict(table)
    kind = type(template)
    family = _family(template)
    if isinstance(wanted, type):
        family = {name: k for name, k in family.items() if issubclass(k, wanted)}
    if family and "type" in rest:
        kind = choice(rest.pop("type"), family, f"{path}.type")
    values = {}
    for field in dataclasses.fields(kind):
        old = getattr(template, field.name, None)
        if field.name in _LEFT_OUT:
            values[field.name] = old
            continue
        key = _key(field, channel)
        if field.name in _NAMED:
            key = field.name
        given = rest.pop(key, None)
        if given is None:
            if old is not None:
                values[field.name] = old
            continue
        where = f"{path}.{key}"
        if field.name in _NAMED:
            values[field.name] = choice(given, _NAMED[field.name], where)
        elif isinstance(old, eqx.Module):
            values[field.name] = decode(old, given, where, field.name, field.type)
        elif field.metadata.get("static", False):
            values[field.name] = whole_number(given, where)
        else:
            values[field.name] = number(given, where)
    allowed = [_key(f, channel) for f in dataclasses.fields(kind)]
    refuse_unknown(rest, [k for k in allowed if k not in _LEFT_OUT], path)
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


class Law(NamedTuple):
    """What a gains file holds.

    Attributes:
        kind: name of the controller's kind.
        controller: with its gains.
        observer: likewise.
        guidance: gains of the line of sight, or None where the file has none.
    """

    kind: str
    controller: AbstractController
    observer: AbstractObserver
    guidance: LineOfSight | None

    def on(self, scenario: Scenario) -> ClosedLoop:
        """The closed loop that steers a scenario with these gains.

        Guidance that the file has replaces that of a waypoint path; a schedule has
        none, and keeps its headings.
        """
        path = scenario.reference
        if self.guidance is not None and isinstance(path, WaypointPath):
            path = dataclasses.replace(path, line_of_sight=self.guidance)
            scenario = dataclasses.replace(scenario, reference=path)
        return ClosedLoop(scenario, self.controller, self.observer)


def encode_law(loop: ClosedLoop) -> dict[str, Any]:
    """Gains of a closed loop as the tables of a gains file."""
    tables = {
        "format": 1,
        "controller": encode(loop.controller),
        "observer": encode(loop.observer),
    }
    path = loop.scenario.reference
    if isinstance(path, WaypointPath):
        tables["guidance"] = encode(path.line_of_sight)
    return tables


def load_gains(path: str | Path, scenario: str, model: Any) -> Law:
    """Read a gains file.

    Args:
        path: of the file, as `jaxglider tune` writes it.
        scenario: `switching` or `waypoints`, for what the file leaves out.
        model: design model.

    Raises:
        ConfigError: names the file, the key, the rule and the value.
    """
    data = read_toml(path)
    try:
        return decode_gains(data, scenario, model)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def decode_gains(data: dict[str, Any], scenario: str, model: Any) -> Law:
    """Gains from parsed TOML.

    Args:
        data: tables of a gains file.
        scenario: `switching` or `waypoints`, for what they leave out.
        model: design model.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = Table(data, "")
    table = top.get("controller")
    kind = Table(table, "controller").text("type")
    choice(kind, FAMILIES[AbstractController], "controller.type")
    controller = decode(
        paper.make_controller(kind, scenario, model), table, "controller"
    )
    observer = decode_observer(top.get("observer", {}), kind, model)
    guidance = top.get("guidance", None)
    if guidance is not None:
        guidance = decode(paper.guidance(), guidance, "guidance")
    top.get("provenance", None)
    choice(str(top.get("format", 1)), {"1": 1}, "format")
    top.close()
    return Law(kind, controller, observer, guidance)


def decode_observer(table: Any, controller: str, model: Any, given: Any = None) -> Any:
    """The observer a table asks for.

    Args:
        table: what the file says of it.
        controller: kind of the controller.
        model: design model.
        given: what the table overrides; the paper's for its controller by default.
    """
    if given is None:
        given = paper.make_observer(controller, model)
    if isinstance(table, dict) and "type" in table:
        allowed = {"none": "smc", "fixed-time": "fxtppc"}
        wanted = paper.make_observer(
            choice(table["type"], allowed, "observer.type"), model
        )
        given = given if type(given) is type(wanted) else wanted
    return decode(given, table, "observer")


def _family(thing: Any) -> dict[str, type]:
    for base, members in FAMILIES.items():
        if isinstance(thing, base):
            return members
    return {}


def _name_in(names: dict[str, Any], value: Any) -> str:
    for name, member in names.items():
        if member is value:
            return name
    raise ConfigError(
        f"{value!r} has no name in {', '.join(names)}: cannot be written."
    )


def _fields(thing: Any) -> list[dataclasses.Field[Any]]:
    return [f for f in dataclasses.fields(thing) if f.name not in _LEFT_OUT]


def _key(field: dataclasses.Field[Any], channel: str) -> str:
    unit = field.metadata.get("unit", "")
    if unit == "channel":
        unit = _CHANNEL_UNITS.get(channel, "")
    return f"{field.name}_{unit}" if unit else field.name
