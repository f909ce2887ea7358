"""Gains tuned by `jaxglider tune` for the paper's cases, as they come with the package.

A folder for each case, in it a file for each plant and controller. Its provenance says
which command made it; `benchmarks/tuned_gains.py` makes them all again.
"""

from pathlib import Path


def tuned_gains(scenario: str, plant: str, controller: str) -> Path:
    """The file of gains tuned for a case.

    Args:
        scenario: `switching` or `waypoints`.
        plant: name of the plant.
        controller: name of the controller.

    Raises:
        ValueError: there is none.
    """
    folder = Path(__file__).parent
    file = folder / scenario / f"{plant}-{controller}.toml"
    if not file.is_file():
        known = sorted(f"{p.parent.name}-{p.stem}" for p in folder.glob("*/*.toml"))
        raise ValueError(
            f"no gains come with jaxglider for {controller} in {scenario} on {plant}; "
            f"there are {', '.join(known)}."
        )
    return file
