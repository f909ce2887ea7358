"""Weights, aggregate and cost of a user's own, from their files."""

import dataclasses
import importlib.util
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError, TomlTable, read_toml
from tuning.problem.objective import CHANNELS, TERMS, Aggregate, Cost, Weights


def load_cost(where: str) -> Cost:
    """A cost function of the user's own, from `path.py:function`.

    It is called with the metrics of a run and those of the starting gains on the
    nominal case, and must be differentiable by JAX. What it gives for the latter tells
    what is much: see `Objective.unit`.

    Raises:
        ValueError: there is no such file or function.
    """
    path, _, name = where.rpartition(":")
    if not path or not Path(path).is_file():
        raise ValueError(
            f"--cost must be FILE.py:FUNCTION with an existing file; "
            f"received {where!r}."
        )
    spec = importlib.util.spec_from_file_location("_users_cost", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"--cost: {path} is no Python file.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"--cost: {path} cannot be run: {error!r}.") from error
    cost = getattr(module, name, None)
    if not callable(cost):
        raise ValueError(f"--cost: {path} has no function {name!r}.")
    return cost


DEFAULT_WEIGHTS = Weights(
    tracking=(1.0, 2.5, 4.0),
    chattering=0.01,
    crowding=60.0,
    roll=10.0,
    saturation=5.0,
)
"""Tracking first, what is hard to win most: heading, then pitch. The rest keeps it in
the funnel, upright, off the buzzer and off the actuators' limits."""


def read_objective(path: Path | None) -> tuple[Weights, Aggregate]:
    """Weights and aggregation from a TOML file, or the defaults.

    Raises:
        ConfigError: names the file, the key and the rule.
    """
    if path is None:
        return DEFAULT_WEIGHTS, Aggregate()
    try:
        top = TomlTable(read_toml(path), "")
        parts = []
        for key, old in (("weights", DEFAULT_WEIGHTS), ("aggregate", Aggregate())):
            table = top.table(key)
            values: dict[str, Any] = {}
            for field in dataclasses.fields(old):
                name = "roll_limit_rad" if field.name == "roll_limit" else field.name
                values[field.name] = _read(table, name, getattr(old, field.name))
            table.close()
            parts.append(_built(type(old), key, values))
        top.close()
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if str(path) in text else f"{path}: {text}") from error
    return parts[0], parts[1]


def _read(table: TomlTable, name: str, old: Any) -> Any:
    """A word, a number, or a number for each channel."""
    given = table.get(name, old)
    if isinstance(given, dict) and name in TERMS:
        by_name = TomlTable(given, f"weights.{name}")
        values = tuple(by_name.number(channel) for channel in CHANNELS)
        by_name.close()
        return values
    if isinstance(old, str):
        return table.text(name, old)
    return old if given is old else table.number(name)


def _built(kind: type, key: str, values: dict[str, Any]) -> Any:
    try:
        return kind(**values)
    except ValueError as error:
        raise ConfigError(f"{key}: {error}") from error
