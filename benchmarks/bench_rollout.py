"""Cost of a rollout, a batch and a gradient: `python benchmarks/bench_rollout.py`.

Each figure is the median of several runs after compilation; compilation is apart. On
a shared machine only the ratios mean anything: they are taken side by side in one run.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import jaxglider

jaxglider.enable_fast_loops()

import equinox as eqx
import jax

from jaxglider import evaluate, map_members, member_keys, paper
from jaxglider.designs import MonteCarlo
from jaxglider.io import provenance
from jaxglider.quantities import uniform_uncertainty
from jaxglider.uncertainty import Member, with_member


def timed(
    function: Callable[..., Any], *arguments: Any, repeats: int
) -> dict[str, float]:
    """Seconds to compile, and the median and extremes of the runs after that."""
    begun = time.perf_counter()
    compiled = jax.jit(function).lower(*arguments).compile()
    compile_s = time.perf_counter() - begun
    jax.block_until_ready(compiled(*arguments))
    runs = []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(compiled(*arguments))
        runs.append(time.perf_counter() - begun)
    return {
        "compile_s": compile_s,
        "run_s": statistics.median(runs),
        "spread": max(runs) / min(runs),
    }


def main() -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--precision", type=int, choices=(32, 64), default=32)
    parser.add_argument("--plant", choices=tuple(paper.PLANTS), default="printed")
    parser.add_argument("--duration", type=float, default=800.0)
    parser.add_argument("--batches", type=int, nargs="+", default=[16, 64, 256])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", options.precision == 64)
    loop = paper.make_loop("switching", options.plant, duration=options.duration)
    sea = loop.scenario.sea(jax.random.key(0))
    ticks = loop.scenario.clock.ticks

    def member(one: Member) -> Any:
        return evaluate(*with_member(loop, one))

    def objective(gains: Any) -> Any:
        changed = eqx.tree_at(lambda at: at.controller.gains, loop, gains)
        channels = evaluate(changed, sea).channels
        return sum(
            getattr(channels, c).rms_error for c in ("depth", "pitch", "heading")
        )

    gains = loop.controller.gains
    rows = {
        "one rollout": (
            1,
            timed(lambda at: evaluate(loop, at), sea, repeats=options.repeats),
        ),
        "value and gradient": (
            1,
            timed(jax.value_and_grad(objective), gains, repeats=options.repeats),
        ),
    }
    uncertainty = uniform_uncertainty(loop.scenario, 0.2)
    design = MonteCarlo(0, uncertainty.names())
    for size in options.batches:
        members = uncertainty.sample(design, member_keys(0, size))
        batch = lambda members: map_members(member, members)
        rows[f"batch of {size}"] = (
            size,
            timed(batch, members, repeats=options.repeats),
        )
    one = rows["one rollout"][1]["run_s"]
    for size, row in rows.values():
        row["over_one_rollout"] = row["run_s"] / one
        row["million_ticks_per_s"] = size * ticks / row["run_s"] / 1e6
    report = {name: row for name, (_, row) in rows.items()}
    about = provenance(precision=options.precision, plant=options.plant, ticks=ticks)
    if options.json:
        print(json.dumps({"rows": report, "provenance": about}, indent=2))
        return
    machine = about["hardware"]
    print(f"{machine['processor']}, {machine['cores']} cores, float{options.precision}")
    titles = ("compile s", "run s", "x one", "M ticks/s", "spread")
    print(f"{'':22}" + "".join(f"{t:>10}" for t in titles))
    for name, r in report.items():
        keys = (
            "compile_s",
            "run_s",
            "over_one_rollout",
            "million_ticks_per_s",
            "spread",
        )
        print(f"{name:22}" + "".join(f"{r[key]:10.4g}" for key in keys))


if __name__ == "__main__":
    main()
