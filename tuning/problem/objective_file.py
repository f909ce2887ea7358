"""Weights, aggregate and cost of a user's own, from their files."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError, TomlTable, read_toml
from jaxglider.files.file_kinds import refuse_other_kind
from jaxglider.files.user_law import load_named
from jaxglider.signals import CHANNELS
from tuning.problem.aggregates import AbstractAggregate, make_aggregate
from tuning.problem.objective import TERMS, Cost, Weights


def load_cost(where: str) -> Cost:
    """A cost function of the user's own, from `path.py:function`.

    It is called with the metrics of a run and those of the starting gains on the
    nominal case, and must be differentiable by JAX. What it gives for the latter tells
    what is much: see `Objective.cost_scale`. So that both may be divided by, the latter
    are never next to nothing: see `baseline.comparable`.

    Raises:
        ValueError: there is no such file or function.
    """
    cost = load_named(where, "--cost", "FUNCTION")
    if not callable(cost):
        raise ConfigError(
            f"--cost must name a function; {where} is {type(cost).__name__}."
        )
    return cost


DEFAULT_WEIGHTS = Weights(
    tracking=(1.0, 2.5, 4.0),
    chattering=0.05,
    travel=0.1,
    crowding=15.0,
    roll=30.0,
    saturation=5.0,
)
"""Tracking first, what is hard to win most: heading, then pitch. The rest keeps it in
the funnel, upright, off the buzzer and off the actuators' limits."""


def read_objective(
    path: Path | None, kind: str | None = None
) -> tuple[Weights, AbstractAggregate]:
    """Weights and aggregate from a TOML file, or the defaults.

    Args:
        path: path of the file, or None for the defaults.
        kind: name of the aggregate, taken instead of the file's.

    Raises:
        ConfigError: names the file, the key and the rule.
    """
    if path is None:
        return DEFAULT_WEIGHTS, make_aggregate(kind or "mean")
    try:
        tables = read_toml(path)
        refuse_other_kind(tables, "objective")
        top = TomlTable(tables, "")
        table = top.table("weights")
        values: dict[str, Any] = {}
        for field in dataclasses.fields(DEFAULT_WEIGHTS):
            name = "roll_limit_rad" if field.name == "roll_limit" else field.name
            values[field.name] = _read(
                table, name, getattr(DEFAULT_WEIGHTS, field.name)
            )
        table.close()
        weights = _built(Weights, "weights", values)
        table = top.table("aggregate")
        numbers = {
            name: table.number(name)
            for name in ("share", "sharpness")
            if table.get(name, None) is not None
        }
        chosen: dict[str, Any] = {"kind": table.text("kind", "mean"), **numbers}
        table.close()
        aggregate = _built(make_aggregate, "aggregate", chosen)
        top.close()
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if str(path) in text else f"{path}: {text}") from error
    if kind is not None:
        aggregate = make_aggregate(**{**chosen, "kind": kind})
    return weights, aggregate


def _read(table: TomlTable, name: str, old: Any) -> Any:
    """A number, or a number for each channel."""
    value = table.get(name, old)
    if isinstance(value, dict) and name in TERMS:
        by_name = TomlTable(value, f"weights.{name}")
        values = tuple(by_name.number(channel) for channel in CHANNELS)
        by_name.close()
        return values
    return old if value is old else table.number(name)


def _built(make: Callable[..., Any], key: str, values: dict[str, Any]) -> Any:
    try:
        return make(**values)
    except ValueError as error:
        raise ConfigError(f"{key}: {error}") from error
