"""The missions that come with the package, by their names."""

from importlib import resources
from pathlib import Path

from jaxglider.core.toml import ConfigError, read_toml


def mission_names() -> list[str]:
    """Names of the missions that come with the package."""
    return sorted(path.stem for path in folder().glob("*.toml"))


def folder() -> Path:
    """The folder of their files."""
    return Path(str(resources.files("jaxglider.files.flight") / "missions"))


def mission_path(name: str) -> Path:
    """The file of a mission of the package.

    Raises:
        ConfigError: there is none of that name.
    """
    path = folder() / f"{name}.toml"
    if not path.is_file():
        raise ConfigError(
            f"mission must be one of {', '.join(mission_names())}; received {name!r}."
        )
    return path


def mission_summaries() -> dict[str, dict[str, str]]:
    """Vehicle, law, task and length of each mission, in words."""
    return {name: _summary(name) for name in mission_names()}


def _summary(name: str) -> dict[str, str]:
    data = read_toml(mission_path(name))
    reference, clock = data.get("reference", {}), data.get("clock", {})
    yo = reference.get("yo", {})
    task = reference.get("type", "schedule")
    if yo:
        task = f"yos to {yo['bottom_depth_m']:g} m"
    hours = float(clock.get("duration_s", 800.0)) / 3600.0
    return {
        "vehicle": str(data.get("vehicle", {}).get("data", "seawing")),
        "controller": str(data.get("controller", {}).get("type", "fxtppc")),
        "task": task,
        "at_most": f"{hours:.3g} h",
        "about": _first_comment(mission_path(name)),
    }


def _first_comment(path: Path) -> str:
    """The first line of a file, which says what the mission is."""
    line = path.read_text(encoding="utf-8").partition("\n")[0]
    return line.lstrip("# ").rstrip(".")
