"""Gains tuned for the paper's cases and for missions, as they come with the package.

A folder for each case or mission, in it one for each plant, in it a file for each
controller. Its provenance says which command made it; `benchmarks/tuned_gains.py` makes
those of the paper's cases again, but for ADRC and fixed-time backstepping, which
`benchmarks/bench_laws.py` made, as it did those of missions.
"""

from pathlib import Path


def has_tuned_gains(scenario: str, plant: str, controller: str) -> bool:
    """Whether gains tuned for a case or a mission come along.

    Args:
        scenario: `switching`, `waypoints`, or the name of a mission, any text.
        plant: name of the plant.
        controller: name of the controller.
    """
    tasks = {path.name for path in Path(__file__).parent.iterdir()}
    return scenario in tasks and _file(scenario, plant, controller).is_file()


def tuned_gains(scenario: str, plant: str, controller: str) -> Path:
    """The file of gains tuned for a case or a mission.

    Args:
        scenario: `switching`, `waypoints`, or the name of a mission.
        plant: name of the plant.
        controller: name of the controller.

    Raises:
        ValueError: there is none.
    """
    file = _file(scenario, plant, controller)
    if not file.is_file():
        folder = Path(__file__).parent
        known = sorted(
            "-".join(p.relative_to(folder).with_suffix("").parts)
            for p in folder.glob("*/*/*.toml")
        )
        raise ValueError(
            f"no gains come with jaxglider for {controller} in {scenario} on {plant}; "
            f"there are {', '.join(known)}."
        )
    return file


def _file(scenario: str, plant: str, controller: str) -> Path:
    return Path(__file__).parent / scenario / plant / f"{controller}.toml"
