"""Gains as TOML: controllers, observers and guidance to nested tables and back.

A table overrides a template: what it leaves out keeps the template's value. Keys carry
the unit of their number where it is not one of the law's own (`settling_time_s`,
`final_bound_rad`). Unknown keys are refused with their path.
"""

from pathlib import Path
from typing import Any

from jaxglider import paper
from jaxglider.control import AbstractController, Funnel
from jaxglider.control.catalogue import OBSERVERS
from jaxglider.control.observer import AbstractObserver
from jaxglider.control.steering import INVERSION
from jaxglider.core.toml import ConfigError, TomlTable, choice, read_toml
from jaxglider.files.codec import decode, encode
from jaxglider.files.file_kinds import refuse_other_kind
from jaxglider.files.law_paths import found_from, is_own, seen_from
from jaxglider.files.user_law import first_gains, source_of
from jaxglider.guidance import LineOfSight
from jaxglider.guidance.routes import route_of
from jaxglider.navigation.catalogue import (
    DEFAULT,
    ESTIMATORS,
    make_estimator,
    usual_instruments,
)
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.navigation.sensing.readings import Instruments
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.gains import LoadedGains as LoadedGains
from jaxglider.vehicle.design_model import DesignModel


def encode_law(loop: ClosedLoop, folder: str | Path | None = None) -> dict[str, Any]:
    """Gains of a closed loop as the tables of a gains file.

    Args:
        loop: closed loop to take the gains of.
        folder: folder that the file is for; a law of one's own is named by its path
            from there. By default its path stays as it is spelt.
    """
    path = route_of(loop.scenario.reference)
    guidance = None if path is None else path.line_of_sight
    tables = encode_gains(loop.controller, loop.observer, guidance, loop.estimator)
    if folder is not None:
        controller = tables["controller"]
        controller["type"] = seen_from(folder, controller["type"])
    return tables


def encode_gains(
    controller: AbstractController,
    observer: AbstractObserver,
    guidance: LineOfSight | None,
    estimator: AbstractEstimator | None = None,
) -> dict[str, Any]:
    """Gains of a law, its observer and its guidance as the tables of a gains file.

    Args:
        controller: control law with its gains.
        observer: disturbance observer with its gains.
        guidance: gains of the line of sight, or None for none.
        estimator: estimator with its gains, or None for none.
    """
    tables = {
        "format": 1,
        "controller": encode(controller),
        "observer": encode(observer),
    }
    if estimator is not None:
        tables["estimator"] = encode(estimator)
    return tables if guidance is None else tables | {"guidance": encode(guidance)}


def load_gains(path: str | Path, scenario: str, model: DesignModel) -> LoadedGains:
    """Read a gains file.

    Args:
        path: path of the file, as `jaxglider tune` writes it.
        scenario: `switching` or `waypoints`, for what the file leaves out.
        model: design model.

    Raises:
        ConfigError: names the file, the key, the rule and the value.
    """
    tables = read_gains(path)
    try:
        return decode_gains(tables, scenario, model)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def read_gains(path: str | Path) -> dict[str, Any]:
    """The tables of a gains file, a law of one's own in them found.

    Raises:
        ConfigError: it cannot be read, or the law's file is not there.
    """
    tables = read_toml(path)
    controller = tables.get("controller")
    try:
        refuse_other_kind(tables, "gains")
        if not isinstance(controller, dict):
            return tables
        controller = with_law_found(controller, Path(path).parent)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return tables | {"controller": controller}


def with_law_found(controller: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table `controller` of a file, with the path of a law of one's own.

    A relative path is looked for in the file's folder, then in the working folder.

    Args:
        controller: table to look into.
        folder: folder of the file that the table is from.

    Raises:
        ConfigError: it is in neither.
    """
    kind = controller.get("type")
    if not is_own(kind):
        return controller
    return controller | {"type": found_from(folder, str(kind))}


def with_law_inside(tables: dict[str, Any]) -> dict[str, Any]:
    """Tables of a gains or mission file that hold the text of a law of one's own.

    They mean the same without the law's file. Tables of other laws stay as they are.

    Raises:
        ConfigError: the file cannot be read.
    """
    controller = tables.get("controller")
    if not isinstance(controller, dict) or not is_own(controller.get("type")):
        return tables
    kind = controller["type"]
    inside = {"name": kind, "text": source_of(kind)}
    return tables | {"controller": controller | {"type": inside}}


def kind_of(controller: TomlTable, default: Any = None) -> tuple[str, str | None]:
    """The law that a table `controller` asks for.

    Args:
        controller: table to read `type` of.
        default: name where it does not say; None where it must.

    Returns:
        Its name, and the text of its file if the table holds it.

    Raises:
        ConfigError: it is missing, or neither text nor a table of name and text.
    """
    if isinstance(controller.get("type", default), dict):
        inside = controller.table("type")
        kind, text = inside.text("name"), inside.text("text")
        inside.close()
        return kind, text
    return controller.text("type", *(() if default is None else (default,))), None


def decode_gains(
    data: dict[str, Any],
    scenario: str,
    model: DesignModel,
    funnel: Funnel | None = None,
) -> LoadedGains:
    """Gains from parsed TOML.

    Args:
        data: tables of a gains file.
        scenario: `switching` or `waypoints`, for what they leave out.
        model: design model.
        funnel: funnel that a law of one's own begins with; the paper's by default.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    top = TomlTable(data, "")
    controller_table = TomlTable(top.get("controller"), "controller")
    kind, text = kind_of(controller_table)
    # Numbers from before there was a choice say nothing of steering: inversion.
    older = INVERSION if _is_older(data["controller"]) else None
    law = first_gains(kind, scenario, model, funnel, text, older)
    controller = decode(law.controller, controller_table.rest(), "controller")
    observer = decode_observer(top.get("observer", {}), law.observer, model)
    guidance = top.get("guidance", None)
    if guidance is not None:
        guidance = decode(paper.guidance(), guidance, "guidance")
    estimator = top.get("estimator", None)
    if estimator is not None:
        estimator = decode_estimator(estimator, None, model)
    top.get("provenance", None)
    choice(str(top.get("format", 1)), {"1": 1}, "format")
    top.close()
    return LoadedGains(kind, controller, observer, guidance, estimator)


def _is_older(controller: dict[str, Any]) -> bool:
    """Whether a table has numbers of a law but no steering."""
    return "steering" not in controller and bool(set(controller) - {"type"})


def decode_estimator(
    table: Any,
    default: AbstractEstimator | None,
    model: DesignModel,
    instruments: Instruments | None = None,
) -> Any:
    """The estimator a table asks for.

    Args:
        table: table of the estimator in the file.
        default: estimator whose numbers the table overrides, if it is of its kind; None
            for the usual one.
        model: design model.
        instruments: sensors that it reads; the usual ones by default.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    kind = DEFAULT if default is None else None
    if isinstance(table, dict) and "type" in table:
        kind = table["type"]
        choice(kind, dict(ESTIMATORS), "estimator.type")
    if kind is not None and type(default) is not ESTIMATORS[kind]:
        default = make_estimator(kind, model, instruments or usual_instruments())
    return decode(default, table, "estimator")


def mission_estimator(
    table: Any,
    own: AbstractEstimator | None,
    model: DesignModel,
    instruments: Instruments | None,
) -> AbstractEstimator | None:
    """The estimator of a mission: that of its table, of its gains, or the usual one.

    Args:
        table: table `estimator` of the mission, or None.
        own: estimator of its gains file, or None.
        model: design model.
        instruments: sensors of the mission, or None for none.

    Raises:
        ConfigError: a table of it without sensors, or a bad value.
    """
    if table is not None and instruments is None:
        raise ConfigError(
            "estimator needs a table sensors, for what it reads; received none. An "
            "empty one, [sensors], stands for those of the vehicle."
        )
    if table is None and (own is not None or instruments is None):
        return own
    estimator: AbstractEstimator = decode_estimator(
        table or {}, own, model, instruments
    )
    return estimator


def decode_observer(table: Any, default: Any, model: DesignModel) -> Any:
    """The observer a table asks for.

    Args:
        table: table of the observer in the file.
        default: observer whose numbers the table overrides.
        model: design model.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    if isinstance(table, dict) and "type" in table:
        choice(table["type"], dict(OBSERVERS), "observer.type")
        other = paper.make_observer(table["type"], model)
        default = default if type(default) is type(other) else other
    return decode(default, table, "observer")
