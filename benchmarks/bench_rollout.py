"""Throughput of rollouts: `python benchmarks/bench_rollout.py`.

Million control ticks per second against the number of members, and at one batch against
controller, plant, precision and cores; how the cost grows with horizon and members, as
the exponent of a power; and what a sweep of ten thousand members takes in time and
memory. The switching case at 20 Hz, members differ in all uncertain parameters.
"""

import argparse
import sys
from typing import Any

import jax
import measuring
import numpy as np

from jaxglider import evaluate


def prepared(
    controller: str = "fxtppc",
    plant: str = "printed",
    *,
    precision: int,
    count: int,
    cores: int = 1,
    ticks: int,
) -> dict[str, Any]:
    """One case: its compiled run, and what it cost to get there."""
    with jax.enable_x64(precision == 64):
        loop, sea = measuring.case(controller, plant, ticks)
        nominal = loop.scenario.plant.parameters
        members = measuring.draw_members(nominal, count, precision)
        devices = jax.devices()[:cores] if cores > 1 else None
        members = measuring.spread(members, devices)
        batch = measuring.batch_of(evaluate, loop, sea, devices)
        program, cost = measuring.compiled(batch, members)

    def run() -> Any:
        with jax.enable_x64(precision == 64):
            return program(members)

    case = {
        "controller": controller,
        "plant": plant,
        "precision": precision,
        "members": count,
        "cores": cores,
        "ticks": ticks,
    }
    return {"run": run, "case": case, **cost}


def timed(cases: list[dict[str, Any]], repeats: int) -> list[dict[str, Any]]:
    """Seconds and speed of some cases, run in turn."""
    runs = {str(i): case["run"] for i, case in enumerate(cases)}
    seconds = measuring.in_turn(runs, repeats)
    rows = []
    for case, spent in zip(cases, seconds.values(), strict=True):
        about = case.pop("case")
        del case["run"]
        middle = float(np.median(spent))
        speed = about["members"] * about["ticks"] / middle / 1e6
        rows.append(
            {
                **about,
                **case,
                "seconds": middle,
                "spread": measuring.spread_of(spent),
                "million_ticks_per_s": speed,
            }
        )
        measuring.say(f"{about}: {speed:.3g} million ticks/s")
    return rows


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    base = {"precision": options.precision, "ticks": options.ticks}
    count = options.at
    other = 96 - options.precision
    variants = [
        {},
        {"controller": "ppc"},
        {"controller": "smc"},
        {"plant": "rigid-body"},
        {"precision": other},
    ]
    if measuring.CORES > 1:
        variants.append({"cores": measuring.CORES})
    shorter = [n for n in (options.ticks // 16, options.ticks // 4) if n >= 20]
    by_batch, by_variant, by_horizon = (
        timed([prepared(**{**base, **change}) for change in changes], options.repeats)
        for changes in (
            [{"count": n} for n in options.batches],
            [{"count": count, **variant} for variant in variants],
            [{"count": count, "ticks": n} for n in (*shorter, options.ticks)],
        )
    )
    big = [prepared(**base, count=options.sweep, cores=measuring.CORES)]
    wide = [row for row in by_batch if row["members"] >= 64]
    result = {
        "by_batch": by_batch,
        "by_variant": by_variant,
        "by_horizon": by_horizon,
        "sweep": timed(big, 1),
        "exponent_of_horizon": measuring.fitted(by_horizon, "ticks", "seconds"),
        "exponent_of_members": measuring.fitted(wide, "members", "seconds"),
    }
    return result


def tables(result: dict[str, Any]) -> str:
    """Everything in one table, and the exponents below it."""
    named: dict[tuple, dict] = {}
    for group in ("by_batch", "by_variant", "by_horizon", "sweep"):
        for row in result[group]:
            name = (
                f"{row['controller']}, {row['plant']}, float{row['precision']}",
                row["members"],
                row["ticks"],
                row["cores"],
            )
            named.setdefault(name, row)
    keys = ("million_ticks_per_s", "seconds", "memory_mib", "trace_s", "compile_s")
    titles = ("", "members", "ticks", "cores", "million ticks/s", "s", "MiB")
    titles = (*titles, "trace s", "compile s", "spread")
    rows = [
        [*name, *(row[key] for key in keys), row["spread"]]
        for name, row in named.items()
    ]
    fits = [
        f"time ~ {what}^{measuring.figure(result[key])}"
        for what, key in (
            ("ticks", "exponent_of_horizon"),
            ("members", "exponent_of_members"),
        )
    ]
    return measuring.markdown(titles, rows) + "\n\n" + "; ".join(fits)


def draw(result: dict[str, Any], options: argparse.Namespace) -> None:
    """Speed against members; speed of the variants; memory against members."""
    whole, (left, middle, right) = measuring.drawing(3)
    rows = result["by_batch"]
    members = [row["members"] for row in rows]
    left.loglog(members, [r["million_ticks_per_s"] for r in rows], "o-", ms=3)
    measuring.label_sizes(left, members)
    left.tick_params(axis="x", labelsize=7)
    left.set_xlabel("members")
    left.set_ylabel("million ticks/s")
    names = [
        f"{r['controller']}\n{r['plant']}\nfloat{r['precision']}, cores: {r['cores']}"
        for r in result["by_variant"]
    ]
    middle.barh(names, [r["million_ticks_per_s"] for r in result["by_variant"]])
    middle.invert_yaxis()
    middle.tick_params(axis="y", labelsize=6)
    middle.set_xlabel(f"million ticks/s, {options.at} members")
    rows = sorted(rows + result["sweep"], key=lambda row: row["members"])
    right.semilogx(
        [r["members"] for r in rows], [r["memory_mib"] for r in rows], "o-", ms=3
    )
    right.set_ylim(bottom=0)
    right.set_xlabel("members")
    right.set_ylabel("working memory [MiB]")
    for panel in (left, middle, right):
        panel.grid(alpha=0.3)
    measuring.save(whole, "rollouts of the closed loop, metrics only", options.plot)


def main() -> int:
    """Measure and print a table, or JSON."""
    parser = measuring.arguments(__doc__)
    parser.add_argument(
        "--batches", type=int, nargs="+", default=[1, 4, 16, 64, 256, 1024, 4096]
    )
    parser.add_argument("--at", type=int, default=256, help="batch of the variants")
    parser.add_argument("--ticks", type=int, default=16000)
    parser.add_argument("--sweep", type=int, default=10000, help="members of a sweep")
    options = parser.parse_args()
    if options.quick:
        options.batches, options.at, options.ticks = [1, 64], 64, 1600
        options.repeats, options.sweep = 3, 1000
    result = measure(options)
    if options.plot is not None:
        draw(result, options)
    measuring.conclude(options, result, tables(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
