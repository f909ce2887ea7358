"""Gains tuned by `jaxglider tune` for the paper's cases, as they come with the package.

One file for each case, plant and controller. Its provenance says which command made it;
`benchmarks/tuned_gains.py` makes them all again.
"""

from pathlib import Path

WORD = "tuned"
"""Stands for these files where the command line takes a gains file."""


def tuned_gains(scenario: str, plant: str, controller: str) -> Path:
    """The file of gains tuned for a case.

    Args:
        scenario: `switching` or `waypoints`.
        plant: name of the plant.
        controller: name of the controller.

    Raises:
        ValueError: there is none.
    """
    file = Path(__file__).parent / f"{scenario}-{plant}-{controller}.toml"
    if not file.is_file():
        known = sorted(path.stem for path in file.parent.glob("*.toml"))
        raise ValueError(
            f"no gains come with jaxglider for {controller} in {scenario} on {plant}; "
            f"there are {', '.join(known)}."
        )
    return file


def resolve(path: Path, scenario: str, plant: str, controller: str) -> Path:
    """The file meant: of the package for the word `tuned`, else the path as given.

    Raises:
        ValueError: the package has none for this case.
    """
    if path == Path(WORD) and not path.exists():
        return tuned_gains(scenario, plant, controller)
    return path
