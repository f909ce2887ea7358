"""Are the results those of an earlier commit, to the last digit?

    python benchmarks/same_digits.py             # runs both commands, some minutes
    python benchmarks/same_digits.py --folder D  # reads D/compare and D/tune instead
    python benchmarks/same_digits.py --record    # keeps what is found as the record

Compares every number of `metrics.json` of `compare --scenario all` and every gain
before and after `tune --steps 3` with those in same_digits.json and prints the largest
relative differences. Exit code 1 where one is above the limit. The figures hold for the
processor and the versions named in that file: another one rounds differently, and a
long run on the edge of a funnel makes more of that.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

RECORD = Path(__file__).with_suffix(".json")
COMMANDS = {
    "compare": ("compare", "--scenario", "all"),
    "tune": ("tune", "--steps", "3"),
}
LIMIT = 1e-12
SHOWN = 20
"""How many numbers are printed, the farthest apart."""


def main() -> int:
    """Run or read the results, then compare or record them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--folder", type=Path, help="results of both commands, if run")
    parser.add_argument("--record", action="store_true", help="write a new record")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="same-digits-") as folder:
        results = options.folder or _run(Path(folder))
        present = _read(results)
    if options.record:
        RECORD.write_text(json.dumps(present, indent=1) + "\n", "utf-8")
        return 0
    recorded = json.loads(RECORD.read_text("utf-8"))
    for name, about in (("recorded", recorded["about"]), ("present", present["about"])):
        print(f"{name}: {json.dumps(about)}")
    worst = [_compare(name, recorded[name], present[name]) for name in COMMANDS]
    return 0 if max(worst) <= LIMIT else 1


def _run(folder: Path) -> Path:
    for name, words in COMMANDS.items():
        command = [sys.executable, "-m", "tuning", *words, "--out", str(folder / name)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def _read(folder: Path) -> dict[str, Any]:
    """The numbers of both commands by name, and what they were computed with."""
    metrics = json.loads((folder / "compare/metrics.json").read_text("utf-8"))
    runs = {
        f"{run['scenario']}/{run['plant']}/{run['controller']}": run
        for run in metrics["runs"]
    }
    about = metrics["provenance"]
    tuned = json.loads((folder / "tune/tune.json").read_text("utf-8"))
    return {
        "about": {
            "created": about["created"],
            "processor": about["hardware"]["processor"],
            "versions": about["versions"],
        },
        "compare": _numbers(runs),
        "tune": _numbers(tuned["gains"]),
    }


def _numbers(tree: Any, name: str = "") -> dict[str, float]:
    """Every number of nested tables by its path."""
    if isinstance(tree, dict):
        return {
            path: number
            for key, part in tree.items()
            for path, number in _numbers(part, f"{name}.{key}" if name else key).items()
        }
    is_number = isinstance(tree, int | float) and not isinstance(tree, bool)
    return {name: float(tree)} if is_number else {}


def _compare(name: str, recorded: dict[str, float], present: dict[str, float]) -> float:
    """Print the largest relative difference, infinite where a number is missing."""
    missing = sorted(recorded.keys() - present.keys())
    if missing:
        print(f"{name}: {len(missing)} numbers are missing, such as {missing[0]}")
        return float("inf")
    off = {path: _off(present[path], recorded[path]) for path in recorded}
    apart = sorted((path for path in off if off[path] > LIMIT), key=off.get)
    print(f"{name}: {len(off)} numbers, at most {max(off.values()):.1e} apart")
    print(f"  {len(apart)} of them by more than {LIMIT:.0e}{':' if apart else ''}")
    for path in reversed(apart[-SHOWN:]):
        print(f"  {off[path]:.1e} {path}: {recorded[path]!r} was recorded")
    return max(off.values())


def _off(found: float, wanted: float) -> float:
    return abs(found - wanted) / max(abs(wanted), 1e-300) if found != wanted else 0.0


if __name__ == "__main__":
    sys.exit(main())
