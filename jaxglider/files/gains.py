"""Gains as TOML: controllers, observers and guidance to nested tables and back.

A table overrides a template: what it leaves out keeps the template's value. Keys carry
the unit of their number where it is not one of the law's own (`settling_time_s`,
`final_bound_rad`). Unknown keys are refused with their path.
"""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from jaxglider import paper
from jaxglider.control import AbstractController
from jaxglider.control.observer import AbstractObserver
from jaxglider.core.toml import (
    ConfigError,
    TomlTable,
    choice,
    read_toml,
)
from jaxglider.files.codec import FAMILIES, decode, encode
from jaxglider.guidance import LineOfSight, WaypointPath
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario


class LoadedGains(NamedTuple):
    """Content of a gains file.

    Attributes:
        kind: name of the controller's kind.
        controller: controller with its gains.
        observer: observer with its gains.
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


def load_gains(path: str | Path, scenario: str, model: Any) -> LoadedGains:
    """Read a gains file.

    Args:
        path: path of the file, as `jaxglider tune` writes it.
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


def decode_gains(data: dict[str, Any], scenario: str, model: Any) -> LoadedGains:
    """Gains from parsed TOML.

    Args:
        data: tables of a gains file.
        scenario: `switching` or `waypoints`, for what they leave out.
        model: design model.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = TomlTable(data, "")
    table = top.get("controller")
    kind = TomlTable(table, "controller").text("type")
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
    return LoadedGains(kind, controller, observer, guidance)


def decode_observer(table: Any, controller: str, model: Any, given: Any = None) -> Any:
    """The observer a table asks for.

    Args:
        table: table of the observer in the file.
        controller: kind of the controller.
        model: design model.
        given: observer whose values the table overrides; the paper's for its controller
            by default.
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
