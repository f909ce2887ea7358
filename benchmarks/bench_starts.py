"""Tune from deliberately bad gains: `python benchmarks/bench_starts.py`.

The paper's gains k1, k2 of all channels times 0.1 and times 10, and the paper's own on
the rigid body's waypoint course, where they lose the glider. Says what the start is
worth on held-out members, what `jaxglider tune` made of it, and what it said.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import tomli_w

from jaxglider import paper
from jaxglider.files.codec import encode
from jaxglider.files.writing import write_text

CASES = {
    "k1, k2 times 0.1": ("switching", 0.1),
    "k1, k2 times 10": ("switching", 10.0),
    "waypoints, as printed": ("waypoints", 1.0),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/starts"))
    parser.add_argument(
        "arguments", nargs="*", help="of `jaxglider tune`, after `--`, for all cases"
    )
    options = parser.parse_args()
    lines = [
        "| start | depth [m] | pitch [rad] | heading [rad] | left a funnel | "
        "past 90° | failed |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    said = []
    for number, (name, (scenario, factor)) in enumerate(CASES.items()):
        out = options.out / str(number)
        write_text(out / "start.toml", tomli_w.dumps(scaled(scenario, factor)))
        done = subprocess.run(
            [
                *(sys.executable, "-m", "tuning", "tune", "--json", "--no-check"),
                *("--scenario", scenario, "--gains", str(out / "start.toml")),
                *("--out", str(out), *options.arguments),
            ],
            stdout=subprocess.PIPE,
            encoding="utf-8",
            check=False,
        )
        if done.returncode:
            return done.returncode
        result = json.loads(done.stdout)
        lines.append(f"| {name} | " + " | ".join(cells(result)) + " |")
        said += [f"- {name}: {text}" for text in result["notes"]]
    text = "\n".join([*lines, "", *said]) + "\n"
    write_text(options.out / "starts.md", text)
    sys.stdout.write(text)
    return 0


def scaled(scenario: str, factor: float) -> dict[str, Any]:
    """The paper's gains with k1 and k2 of every channel times a factor."""
    model = paper.design_model(paper.make_scenario(scenario, "rigid-body").plant)
    table = encode(paper.make_controller("fxtppc", scenario, model))
    for gains in table["gains"].values():
        gains["k1"] *= factor
        gains["k2"] *= factor
    return {"controller": table}


def cells(result: dict[str, Any]) -> list[str]:
    """Before and after on the held-out members."""
    errors = [result["held_out"][c]["rms_error"] for c in ("depth", "pitch", "heading")]
    before, after = result["counts"]["before"], result["counts"]["after"]
    return [
        *(f"{number(row['before'])} → {number(row['after'])}" for row in errors),
        *(
            f"{before[k]} → {after[k]} of {after['members']}"
            for k in ("outside_funnel", "capsized", "not_finite")
        ),
    ]


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main())
