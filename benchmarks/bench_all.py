"""All benchmarks of speed, for docs/speed.md: `python benchmarks/bench_all.py`.

Each runs in a process of its own, one after the other, and leaves its figures and its
picture in the folder `--out`. The tables come on standard output as Markdown. Leave the
machine alone meanwhile: a busy one slows all, and not always alike.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PEERS, ROLLOUT, GRADIENT, COMPILE = "peers", "rollout", "gradient", "compile"
BENCHMARKS = (PEERS, ROLLOUT, GRADIENT, COMPILE)


def run(name: str, quick: bool, out: Path) -> dict[str, Any]:
    """One benchmark in a process of its own; its figures.

    Raises:
        SystemExit: it failed, with its exit code.
    """
    command = [sys.executable, str(HERE / f"bench_{name}.py"), "--json"]
    command += ["--plot", str(out / f"{name}.png"), *(["--quick"] if quick else [])]
    print(f"bench_{name}", file=sys.stderr, flush=True)
    done = subprocess.run(
        command, stdout=subprocess.PIPE, encoding="utf-8", check=False
    )
    if done.returncode != 0:
        raise SystemExit(done.returncode)
    (out / f"{name}.json").write_text(done.stdout, encoding="utf-8")
    return json.loads(done.stdout)


def number(value: Any) -> str:
    """Three digits; a dash where there is none."""
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def speed_table(rows: list[dict[str, Any]]) -> str:
    """Million ticks per second of all peers, one row for each batch."""
    names = list(dict.fromkeys(name for row in rows for name in row["peers"]))
    names.sort(key=lambda name: name != "jaxglider")
    titles = ["members", "cores", *names, "jaxglider / best C"]
    lines = ["| " + " | ".join(titles) + " |", "|" + "---:|" * len(titles)]
    for row in rows:
        got = row["peers"]
        cells = [str(row["batch"]), str(row["cores"])]
        cells += [number(got.get(n, {}).get("million_ticks_per_s")) for n in names]
        cells.append(number(got.get("jaxglider", {}).get("over_best_c")))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def sentences(results: dict[str, Any]) -> str:
    """What the other benchmarks found, in words."""
    (sweep,) = results[ROLLOUT]["sweep"]
    ratios = [r for r in results[GRADIENT]["ratios"] if r["mode"] == "reverse"]
    listed = ", ".join(number(r["over_rollout"]) for r in ratios)
    counts = ", ".join(str(r["members"]) for r in ratios)
    forward = [r for r in results[GRADIENT]["ratios"] if r["mode"] == "forward"]
    fewest = min(forward, key=lambda r: (r["members"], r["gains"]))
    fresh = results[COMPILE]["fresh"]

    def slowest(kind: str) -> str:
        spent = [r["trace_s"] + r["compile_s"] for r in fresh if r["program"] == kind]
        return number(max(spent)) if spent else "–"

    starts = "; ".join(
        f"{r['program']} {number(r['cold']['whole_s'])} s, then "
        f"{number(r['warm']['whole_s'])} s"
        for r in results[COMPILE]["starts"]
    )
    return "\n".join(
        [
            f"- A sweep of {sweep['members']} members of {sweep['ticks']} ticks takes "
            f"{number(sweep['seconds'])} s on {sweep['cores']} cores and "
            f"{number(sweep['memory_mib'])} MiB of working memory.",
            f"- Value and gradient over all {ratios[0]['gains']} gains cost {listed} "
            f"rollouts at {counts} members (reverse mode); forward mode over "
            f"{fewest['gains']} gains costs {number(fewest['over_rollout'])} at "
            f"{fewest['members']}.",
            f"- Tracing and compiling takes at most {slowest('rollout')} s for a "
            f"rollout, {slowest('gradient')} s for a gradient. A whole process with an "
            f"empty persistent cache, and again: {starts}.",
        ]
    )


def main() -> int:
    """Run them and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few cases, short runs")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = {name: run(name, options.quick, options.out) for name in BENCHMARKS}
    about = results[PEERS]["provenance"]
    hardware, settings = about["hardware"], about["settings"]
    print(
        f"{hardware['processor']}, {about['available_cores']} cores, "
        f"jax {about['versions']['jax']}; million ticks/s, "
        f"float{settings['precision']}, median of {settings['repeats']}:\n"
    )
    print(speed_table(results[PEERS]["speed"]), sentences(results), sep="\n\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
