"""Gains tuned by `jaxglider tune` for the paper's cases, as they come with the package.

A folder for each case, in it one for each plant, in it a file for each controller. Its
provenance says which command made it; `benchmarks/tuned_gains.py` makes them all again,
but for those of ADRC and fixed-time backstepping, which `benchmarks/bench_laws.py`
made.
"""

from pathlib import Path


def has_tuned_gains(scenario: str, plant: str, controller: str) -> bool:
    """Whether gains tuned for a case come along.

    Args:
        scenario: `switching` or `waypoints`.
        plant: name of the plant.
        controller: name of the controller.
    """
    return _file(scenario, plant, controller).is_file()


def tuned_gains(scenario: str, plant: str, controller: str) -> Path:
    """The file of gains tuned for a case.

    Args:
        scenario: `switching` or `waypoints`.
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
