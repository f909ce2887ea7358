"""The kind of a file of tables, told by its keys."""

from typing import Any

from jaxglider.core.toml import ConfigError
from jaxglider.vehicle.published import VEHICLE_TABLES

_SHARED = {"actuators", "disturbance", "initial_state", "vehicle"}
_KEYS = {
    "gains": {"format", "controller", "observer", "guidance", "provenance"}
    | {"estimator"},
    "mission": _SHARED
    | {"name", "seed", "clock", "controller", "funnel", "observer", "reference"}
    | {"energy", "seabed", "specification", "water"}
    | {"estimator", "sensors"},
    "objective": {"weights", "aggregate"},
    "uncertainty": _SHARED | {"failure", "sensors"},
    "vehicle": set(VEHICLE_TABLES),
}
"""Keys at the top of each kind of file."""

_USES = {
    "gains": "--gains of a command or controller.gains_file of a mission",
    "mission": "--config of a command",
    "objective": "--objective of `jaxglider tune`",
    "uncertainty": "--uncertainty of a command",
    "vehicle": "vehicle.data of a mission",
}
"""The place that each kind of file is named in."""


def refuse_other_kind(tables: dict[str, Any], wanted: str) -> None:
    """Refuse the tables of a file that is plainly of another kind.

    Args:
        tables: parsed TOML.
        wanted: kind of file that is read, such as `gains`.

    Raises:
        ConfigError: says what the file is, and where such a file is named.
    """
    keys = set(tables)
    # Missions and uncertainty files share names; only the latter's vehicle is a list.
    several = wanted == "mission" and isinstance(tables.get("vehicle"), list)
    if keys <= _KEYS[wanted] and not several:
        return
    for kind, known in _KEYS.items():
        if keys <= known and kind != wanted:
            raise ConfigError(
                f"this is {_a(kind)} file, not {_a(wanted)} file; name it in "
                f"{_USES[kind]}."
            )


def _a(kind: str) -> str:
    return f"{'an' if kind[0] in 'ou' else 'a'} {kind}"
