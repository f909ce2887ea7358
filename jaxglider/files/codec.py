"""Modules to nested tables of plain numbers and back."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx

from jaxglider.control import AbstractController
from jaxglider.control.catalogue import (
    BY_NAME,
    OBSERVERS,
    PERFORMANCE_FUNCTIONS,
    STEERINGS,
)
from jaxglider.control.fxtppc import EXPONENTS
from jaxglider.control.observer import AbstractObserver
from jaxglider.control.prescribed.performance import AbstractPerformanceFunction
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.toml import (
    ConfigError,
    choice,
    number,
    refuse_unknown,
    whole_number,
)
from jaxglider.files.user_law import spec_of
from jaxglider.navigation.catalogue import ESTIMATORS
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.signals import CHANNEL_UNITS
from jaxglider.vehicle.design_model import DesignModel

FAMILIES: dict[type, dict[str, type]] = {
    AbstractController: {name: entry.cls for name, entry in BY_NAME.items()},
    AbstractObserver: dict(OBSERVERS),
    AbstractEstimator: dict(ESTIMATORS),
    AbstractPerformanceFunction: dict(PERFORMANCE_FUNCTIONS),
    AbstractSteering: dict(STEERINGS),
}
"""Names of the members of each family, as they stand under `type`."""


_NAMED: dict[str, dict[str, Callable[..., Any]]] = {"exponents": EXPONENTS}


def encode(thing: eqx.Module, channel: str = "") -> dict[str, Any]:
    """A controller, an observer or a part of one as nested tables of plain numbers.

    Args:
        thing: object to encode; its design model is left out.
        channel: name of the enclosing channel, which some units depend on.
    """
    table: dict[str, Any] = {}
    family = _family(thing)
    if family:
        table["type"] = _type_name(family, type(thing))
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if value is None or isinstance(value, DesignModel):
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
    template: Any,
    table: Any,
    path: str,
    channel: str = "",
    wanted: Any = object,
    beside: Sequence[str] = (),
) -> Any:
    """A copy of the template with the numbers of a table.

    Args:
        template: object of the kind wanted, with the values for everything that the
            table leaves out.
        table: nested tables, as `encode` makes them.
        path: path of the table in its file, for messages.
        channel: name of the enclosing channel.
        wanted: type of the field it is for; a `type` of another kind is refused.
        beside: names of keys that the table may have, read before; for messages.

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
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        old = getattr(template, field.name, None)
        if isinstance(old, DesignModel):
            values[field.name] = old
            continue
        key = _key(field, channel)
        if field.name in _NAMED:
            key = field.name
        value = rest.pop(key, None)
        if value is None:
            if old is not None:
                values[field.name] = old
            continue
        where = f"{path}.{key}"
        if field.name in _NAMED:
            values[field.name] = choice(value, _NAMED[field.name], where)
        elif isinstance(old, eqx.Module):
            values[field.name] = decode(old, value, where, field.name, field.type)
        elif field.metadata.get("static", False):
            values[field.name] = whole_number(value, where)
        else:
            values[field.name] = number(value, where)
    allowed = [*beside, *(["type"] if family else [])]
    allowed += [
        _key(field, channel)
        for field in dataclasses.fields(kind)
        if not isinstance(getattr(template, field.name, None), DesignModel)
    ]
    refuse_unknown(rest, allowed, path)
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


def _family(thing: Any) -> dict[str, type]:
    for base, members in FAMILIES.items():
        if isinstance(thing, base):
            return members
    return {}


def _type_name(family: dict[str, type], cls: type) -> str:
    """Name of a class under `type`; of a law of one's own, FILE.py:ClassName."""
    own = None if cls in family.values() else spec_of(cls)
    return own or _name_in(family, cls)


def _name_in(names: dict[str, Any], value: Any) -> str:
    for name, member in names.items():
        if member is value:
            return name
    raise ConfigError(
        f"{value!r} has no name in {', '.join(names)}: cannot be written."
    )


def _key(field: dataclasses.Field[Any], channel: str) -> str:
    unit = field.metadata.get("unit", "")
    if unit == "channel":
        unit = CHANNEL_UNITS.get(channel, "")
    return f"{field.name}_{unit}" if unit else field.name
