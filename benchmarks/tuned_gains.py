"""Make the gains that come with jaxglider: `python benchmarks/tuned_gains.py`.

Tunes every controller on every plant and case with 200 steps of `jaxglider tune`,
copies the gains into the package, and writes a table of what they are worth on members
that neither descent nor choice has seen. Where the folder `starts` has a file for a
case, the descent starts from it, else from the paper's gains, and likewise for an
objective. Cases can be named to make a part again; the table is of all that `--out`
holds. Run it in the folder above.
"""

import argparse
import itertools
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from jaxglider.io import replacing, write_text
from tuning.arguments import CONTROLLERS, PLANTS, SCENARIOS

STARTS = Path("benchmarks", "starts")
PACKAGE = Path(__file__).parent.parent / "jaxglider" / "tuned"
PAPER_BEST = {
    "switching": {"depth": 0.0995, "pitch": 0.0449, "heading": 0.1966},
    "waypoints": {"depth": 0.1340, "pitch": 0.1516, "heading": 0.1574},
}
"""L2[e] of the best average-tracking cell that the paper prints [m, rad, rad]."""
LABELS = {"smc": "SMC", "ppc": "PPC", "fxtppc": "FxTPPC"}


def main() -> int:
    options = _parser().parse_args()
    cases = ["-".join(x) for x in itertools.product(SCENARIOS, PLANTS, CONTROLLERS)]
    for name in options.only or cases:
        if name not in cases:
            sys.stderr.write(f"{name} must be one of {', '.join(cases)}.\n")
            return 2
        code = _tune(name, options.out / name, options.arguments)
        if code:
            return code
    found = [options.out / name / "tune.json" for name in cases]
    results = [json.loads(path.read_text()) for path in found if path.is_file()]
    table = _table(results)
    write_text(options.out / "tuned.md", table)
    sys.stdout.write(table)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/tuned"))
    parser.add_argument("--only", nargs="+", metavar="SCENARIO-PLANT-CONTROLLER")
    parser.add_argument(
        "arguments", nargs="*", help="of `jaxglider tune`, after `--`, for all cases"
    )
    return parser


def _tune(name: str, out: Path, more: list[str]) -> int:
    scenario, rest = name.split("-", 1)
    plant, controller = rest.rsplit("-", 1)
    case = ("--scenario", scenario, "--plant", plant, "--controller", controller)
    start = STARTS / f"{name}.toml"
    given = ("--gains", str(start)) if start.is_file() else ()
    objective = STARTS / f"{name}-objective.toml"
    if objective.is_file():
        given = (*given, "--objective", str(objective))
    words = ("tune", *case, *given, "--steps", "200", *more, "--out", str(out))
    command = (sys.executable, "-m", "tuning", *words)
    sys.stderr.write(f"{name}\n")
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    if done.returncode == 0:
        with replacing(PACKAGE / f"{name}.toml") as temporary:
            temporary.write_bytes((out / "gains.toml").read_bytes())
    return done.returncode


def _table(results: list[dict[str, Any]]) -> str:
    lines = [
        "| case | plant | law | depth [m] | pitch [rad] | heading [rad] | "
        "chattering, heading | left a funnel | past 90° |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        rows = result["held_out"]
        cells = [result["scenario"], result["plant"], LABELS[result["controller"]]]
        for channel in ("depth", "pitch", "heading"):
            row = rows[channel]["rms_error"]
            best = PAPER_BEST[result["scenario"]][channel]
            share = "-"
            if row["after"] is not None:
                share = f"{100.0 * (1.0 - row['after'] / best):+.0f} %"
            cells.append(f"{_cell(row['before'])} → {_cell(row['after'])} ({share})")
        row = rows["heading"]["chattering"]
        cells.append(f"{_cell(row['before'])} → {_cell(row['after'])}")
        for count in ("outside_funnel", "capsized"):
            before, after = (result["counts"][x] for x in ("before", "after"))
            cells.append(f"{before[count]} → {after[count]} of {after['members']}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main())
