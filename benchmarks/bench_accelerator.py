"""An accelerator beside the CPU: `python benchmarks/bench_accelerator.py`.

Million control ticks per second against the number of members, in both precisions, for
rollouts and for gradients over all gains: all members in one block, against this
machine's CPU cores with blocks of lanes. The switching case at 20 Hz, FxTPPC on the
printed plant, members differ in all uncertain parameters; compilation apart. Where
JAX sees no accelerator the exit code is 1.
"""

import argparse
import sys
from collections.abc import Callable
from typing import Any

import jax
import measuring
import numpy as np
from bench_gradient import Objective

from jaxglider import evaluate


def main() -> int:
    """Measure and print a table, or JSON."""
    parser = measuring.arguments(__doc__)
    parser.add_argument(
        "--batches", type=int, nargs="+", default=[2**10, 2**14, 2**17, 2**20]
    )
    parser.add_argument(
        "--gradient-batches", type=int, nargs="+", default=[2**10, 2**14, 2**17]
    )
    parser.add_argument("--ticks", type=int, default=400)
    options = parser.parse_args()
    options.plant = "printed"
    if jax.default_backend() == "cpu":
        measuring.say("JAX sees no accelerator here: nothing to measure.")
        return 1
    if options.quick:
        options.batches, options.gradient_batches, options.repeats = [64, 1024], [64], 2
    rows = measure(options)
    if options.plot is not None:
        draw(rows, options)
    titles = ("what", "on", "precision", "members", "million ticks/s", "trace s")
    keys = ("what", "on", "precision", "members", "million_ticks_per_s", "trace_s")
    titles, keys = (*titles, "compile s", "spread"), (*keys, "compile_s", "spread")
    table = measuring.markdown(titles, [[row[key] for key in keys] for row in rows])
    measuring.conclude(options, {"rows": rows}, f"{accelerator()}\n\n{table}")
    return 0


def accelerator() -> str:
    """What it is, in words."""
    return str(jax.devices()[0].device_kind)


def measure(options: argparse.Namespace) -> list[dict[str, Any]]:
    """All figures, a batch at a time."""
    rows = []
    for what, batches in (
        ("rollout", options.batches),
        ("gradient", options.gradient_batches),
    ):
        for precision in (32, 64):
            for members in batches:
                rows.append(timed(what, "accelerator", precision, members, options))
            rows.append(timed(what, "CPU", precision, min(4096, batches[-1]), options))
    return rows


def timed(
    what: str, where: str, precision: int, members: int, options: argparse.Namespace
) -> dict[str, Any]:
    """One program at one batch."""
    on_cpu = where == "CPU"
    host = jax.devices("cpu")
    place = host[0] if on_cpu else jax.devices()[0]
    devices = host if on_cpu else None
    block = 64 if on_cpu else members
    with jax.enable_x64(precision == 64), jax.default_device(place):
        function, inputs = case(what, precision, members, options.ticks)
        program, cost = measuring.compiled(
            lambda *given: function(*given, devices=devices, block=block), *inputs
        )
        seconds = measuring.in_turn({"": lambda: program(*inputs)}, options.repeats)
    spent = seconds[""]
    middle = float(np.median(spent))
    row = {
        "what": what,
        "on": where,
        "precision": precision,
        "members": members,
        "seconds": middle,
        "million_ticks_per_s": members * options.ticks / middle / 1e6,
        "spread": measuring.spread_of(spent),
        **cost,
    }
    measuring.say(f"{row}")
    return row


def case(
    what: str, precision: int, members: int, ticks: int
) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """A batch of rollouts or of gradients, and what it takes."""
    if what == "gradient":
        options = argparse.Namespace(plant="printed", precision=precision)
        objective = Objective(options, members, ticks)
        return objective.reverse, (objective.flat,)
    loop, sea = measuring.case("fxtppc", "printed", ticks)
    drawn = measuring.draw_members(loop.scenario.plant.parameters, members, precision)

    def rollouts(parameters: Any, **options: Any) -> Any:
        return measuring.batch_of(evaluate, loop, sea, **options)(parameters)

    return rollouts, (drawn,)


def draw(rows: list[dict[str, Any]], options: argparse.Namespace) -> None:
    """Speed against members, for rollouts and for gradients."""
    whole, panels = measuring.drawing(2)
    for panel, what in zip(panels, ("rollout", "gradient"), strict=True):
        for precision, colour in ((32, "C0"), (64, "C1")):
            of = [r for r in rows if (r["what"], r["precision"]) == (what, precision)]
            points = [r for r in of if r["on"] == "accelerator"]
            members = [r["members"] for r in points]
            speeds = [r["million_ticks_per_s"] for r in points]
            label = f"float{precision}"
            panel.loglog(members, speeds, "o-", ms=3, color=colour, label=label)
            (host,) = (r["million_ticks_per_s"] for r in of if r["on"] == "CPU")
            label = f"CPU, {measuring.CORES} cores, float{precision}"
            panel.axhline(host, ls="--", color=colour, lw=1, label=label)
        panel.set_xlabel("members")
        panel.set_title(what, fontsize=8)
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("million ticks/s")
    panels[0].legend(frameon=False, fontsize=7)
    measuring.save(whole, accelerator(), options.plot)


if __name__ == "__main__":
    sys.exit(main())
