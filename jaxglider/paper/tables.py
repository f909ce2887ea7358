"""The paper's two printed tables of results."""

import functools
import tomllib
from importlib import resources
from typing import Any


@functools.cache
def printed_tables() -> dict[str, Any]:
    """The paper's two tables: scenario, channel, row, then a list over `columns`."""
    return tomllib.loads(
        (resources.files("jaxglider.paper") / "tables.toml").read_text(encoding="utf-8")
    )


def printed_value(
    scenario: str, channel: str, controller: str, row: str
) -> float | None:
    """One number of the printed tables, or None where they have none.

    Args:
        scenario: `switching` or `waypoints`.
        channel: `depth`, `pitch` or `heading`.
        controller: `smc`, `ppc` or `fxtppc`.
        row: `transient`, `average_tracking`, `average_effort` or `chattering`.
    """
    tables = printed_tables()
    if scenario not in tables or controller not in tables["columns"]:
        return None
    column = tables["columns"].index(controller)
    return float(tables[scenario][channel][row][column])
