"""A glider's day: `python benchmarks/bench_day.py`.

The shallow Slocum flies on and on, its waypoint out of reach. Processor time, compiled
before, on one core: of a day; of an hour of it with other control periods, integration
steps and records; and of the gradient of three hours of it by all gains of the law, for
16 members that differ in all uncertain parameters. Memory is what the compiled program
asks for; on Linux also the most that the process held meanwhile over what it held
before, and the most that it held while it compiled, JAX and Python included.
"""

import argparse
import dataclasses
import math
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if hasattr(os, "sched_setaffinity"):
    # Before JAX starts its threads, which are as many as there are cores.
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import equinox as eqx
import jax
import measuring

from jaxglider import evaluate, map_members, simulate
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import load_mission
from jaxglider.guidance.phases import STATUSES, UNFINISHED
from jaxglider.simulation.rollout import sparse_checkpoints
from jaxglider.simulation.scenario import Clock

HOUR = 3600.0
FAR = 1e6
"""Place of the waypoint, north [m]."""
PERIOD, STEP = 4.0, 0.5
"""Control period and longest integration step of the mission [s]."""
VARIANTS: tuple[tuple[float, float, int | None], ...] = (
    (PERIOD, STEP, None),
    (PERIOD, 1.0, None),
    (PERIOD, 0.25, None),
    (1.0, STEP, None),
    (0.1, 0.1, None),
    (PERIOD, STEP, 1),
    (PERIOD, STEP, 15),
)
"""Control period, longest integration step [s], ticks from record to record or None."""


def yos(hours: float, period: float = PERIOD, step: float = STEP) -> Any:
    """The closed loop of the shallow Slocum for some hours."""
    loop = load_mission(mission_path("slocum-shallow")).loop
    clock = Clock.sampled(hours * HOUR, period, step)
    scenario = dataclasses.replace(loop.scenario, clock=clock)
    loop = dataclasses.replace(loop, scenario=scenario)
    course = lambda one: one.scenario.reference.course.north
    return eqx.tree_at(course, loop, 0.0 * course(loop) + FAR)


def flown(metrics: Any) -> dict[str, Any]:
    """Hours and dives of a run, which must have lasted to its end."""
    status = int(metrics.status)
    if status != UNFINISHED:
        raise SystemExit(f"the flight ended early: {STATUSES[status]}")
    return {
        "hours": float(metrics.end_time) / HOUR,
        "dives": int(metrics.flight.dives),
    }


def held(field: str) -> float:
    """Memory of this process [MiB]; NaN where the system does not tell.

    Args:
        field: `VmRSS` for what it holds now, `VmHWM` for the most since it was asked.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return math.nan
    return next(float(x.split()[1]) / 1024 for x in lines if x.startswith(field))


def most_held(run: Callable[[], Any]) -> float:
    """The most that the process holds during a run over what it held before [MiB]."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return math.nan
    before = held("VmRSS")
    run()
    return held("VmHWM") - before


def timed(
    program: Callable[..., Any], inputs: tuple[Any, ...], repeats: int
) -> dict[str, float]:
    """Median seconds of runs, on the clock and of the processor; memory of one."""

    def run() -> Any:
        return jax.block_until_ready(program(*inputs))

    most = most_held(run)
    clock, processor = [], []
    for _ in range(repeats):
        begun, used = time.perf_counter(), time.process_time()
        run()
        processor.append(time.process_time() - used)
        clock.append(time.perf_counter() - begun)
    return {
        "seconds": statistics.median(clock),
        "processor_s": statistics.median(processor),
        "most_held_mib": most,
    }


def flight(
    hours: float,
    repeats: int,
    period: float = PERIOD,
    step: float = STEP,
    every: int | None = None,
) -> dict[str, Any]:
    """A flight: metrics alone, or with every nth tick recorded."""
    loop = yos(hours, period, step)
    sea = loop.scenario.sea(jax.random.key(0))

    def run(loop: Any, sea: Any) -> Any:
        if every is None:
            return evaluate(loop, sea)
        return simulate(loop, sea, keep_every=every)

    program, cost = measuring.compiled(run, loop, sea)
    spent = timed(program, (loop, sea), repeats)
    found = program(loop, sea)
    records = jax.tree.leaves(found.ticks) if every else []
    row = {
        "period_s": period,
        "step_s": period / loop.scenario.clock.substeps,
        "records": f"every {every * period:g} s" if every else "none",
        "records_mib": sum(x.nbytes for x in records) / 2**20,
        **cost,
        **spent,
        **flown(found.metrics if every else found),
    }
    row["processor_s_per_hour"] = row["processor_s"] / row["hours"]
    measuring.say(f"{row}")
    return row


def gradient(
    hours: float, members: int, repeats: int, every: int | None = None
) -> dict[str, Any]:
    """The gradient by all gains of the law, a state kept every so many ticks."""
    loop = yos(hours)
    ticks = loop.scenario.clock.ticks
    every = sparse_checkpoints(ticks) if every is None else every
    gains, rest = eqx.partition(loop.controller, eqx.is_inexact_array)
    sea = loop.scenario.sea(jax.random.key(0))
    nominal = loop.scenario.plant.parameters
    drawn = measuring.draw_members(nominal, members, 64)

    def loss(gains: Any, parameters: Any) -> tuple[Any, Any]:
        one = eqx.tree_at(
            lambda at: (at.controller, at.scenario.plant.parameters),
            loop,
            (eqx.combine(gains, rest), parameters),
        )
        metrics = evaluate(one, sea, checkpoint_every=every)
        flight = metrics.flight
        return flight.heading_error + flight.energy_per_through_water / 10.0, metrics

    def slopes(gains: Any, members: Any) -> Any:
        each = jax.value_and_grad(loss, has_aux=True)
        return map_members(lambda p: each(gains, p), members)

    program, cost = measuring.compiled(slopes, gains, drawn)
    process = held("VmHWM")
    spent = timed(program, (gains, drawn), repeats)
    (_, metrics), slope = program(gains, drawn)
    row = {
        "members": members,
        "ticks": ticks,
        "checkpoint_every": every,
        "process_mib": process,
        "finite": all(bool(abs(x).max() < math.inf) for x in jax.tree.leaves(slope)),
        **cost,
        **spent,
        "hours": float(metrics.end_time.max()) / HOUR,
        "dives": int(metrics.flight.dives.sum()),
    }
    measuring.say(f"{row}")
    return row


def tables(result: dict[str, Any]) -> str:
    """The day, what an hour costs, and the gradients."""
    day = [
        [f"{r['hours']:g} h", *(r[k] for k in ("dives", "processor_s", "seconds"))]
        for r in result["day"]
    ]
    hours = [
        [
            f"{r['period_s']:g} s",
            f"{r['step_s']:g} s",
            r["records"],
            1e3 * r["processor_s_per_hour"],
            r["records_mib"] / r["hours"],
        ]
        for r in result["hours"]
    ]
    keys = ("processor_s", "memory_mib", "most_held_mib", "process_mib")
    slopes = [
        [f"{r['hours']:g} h, {r['members']} members", str(r["checkpoint_every"])]
        + [r[key] for key in keys]
        for r in result["gradients"]
    ]
    return "\n\n".join(
        [
            measuring.markdown(["flight", "dives", "processor s", "s"], day),
            measuring.markdown(
                [
                    "control period",
                    "integration step",
                    "records",
                    "processor ms per hour flown",
                    "MiB of records per hour flown",
                ],
                hours,
            ),
            measuring.markdown(
                [
                    "gradient",
                    "ticks from state to state",
                    "processor s",
                    "MiB of the program",
                    "MiB held more, at most",
                    "MiB of the process, compiling",
                ],
                slopes,
            ),
        ]
    )


def main() -> int:
    """Measure and tell."""
    parser = measuring.arguments(__doc__)
    parser.set_defaults(precision=64, repeats=3)
    options: argparse.Namespace = parser.parse_args()
    jax.config.update("jax_enable_x64", options.precision == 64)
    if options.quick:
        options.repeats = 1
    hours, short = (1.0, 0.5) if options.quick else (24.0, 3.0)
    variants = VARIANTS[:1] if options.quick else VARIANTS
    slopes = (1,) if options.quick else (1, None)
    result = {
        # First: what the process holds is its own then.
        "gradients": [gradient(short, 16, options.repeats, n) for n in slopes],
        "day": [flight(hours, options.repeats)],
        "hours": [flight(short, options.repeats, *one) for one in variants],
    }
    measuring.conclude(options, result, tables(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
