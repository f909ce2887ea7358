"""What all benchmarks share: a started JAX, cases, clocks, tables and pictures.

Import it before anything that computes: it asks for one host device per core and for
the fast loops. Every figure is a median of runs after compilation; what is compared is
measured in turn, one run of each at a time, so that a busy machine slows all alike.
"""

import argparse
import json
import math
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
os.environ["XLA_FLAGS"] = (
    os.environ.get("XLA_FLAGS", "") + f" --xla_force_host_platform_device_count={CORES}"
).strip()

import jaxglider

jaxglider.enable_fast_loops()

import equinox as eqx
import jax
import matplotlib
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from matplotlib.figure import Figure
from peers.problem import draw_members as draw_members

from jaxglider import map_members, paper
from jaxglider.files.writing import provenance, replacing


def arguments(description: str) -> argparse.ArgumentParser:
    """A parser with what every benchmark takes."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--precision", type=int, choices=(32, 64), default=32)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="few cases, short runs")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")
    parser.add_argument("--plot", type=Path, default=None, help="picture to draw")
    return parser


def say(text: str) -> None:
    """Tell how far it is, on standard error."""
    print(text, file=sys.stderr, flush=True)


def batch_of(
    evaluate: Callable[[Any, Any], Any],
    loop: Any,
    sea: Any,
    devices: Sequence[Any] | None = None,
    **options: Any,
) -> Callable[[Any], Any]:
    """`evaluate(loop, sea)` for many sets of true parameters."""

    def member(parameters: Any) -> Any:
        where = lambda at: at.scenario.plant.parameters
        return evaluate(eqx.tree_at(where, loop, parameters), sea)

    return lambda members: map_members(member, members, devices=devices, **options)


def spread(members: Any, devices: Sequence[Any] | None) -> Any:
    """The members, each share already on the device that is to compute it."""
    if not devices or len(jax.tree.leaves(members)[0]) % len(devices):
        return members
    mesh = Mesh(np.asarray(devices), ("members",))
    return jax.device_put(members, NamedSharding(mesh, PartitionSpec("members")))


def case(controller: str, plant: str, ticks: int, dt: float = 0.05) -> tuple[Any, Any]:
    """A closed loop of the paper's first case and its sea."""
    loop = paper.make_loop(
        "switching", plant, controller, duration=(ticks - 0.5) * dt, dt=dt
    )
    return loop, loop.scenario.sea(jax.random.key(0))


def compiled(function: Callable[..., Any], *inputs: Any) -> tuple[Any, dict[str, Any]]:
    """A compiled program, with seconds to trace and to compile and its memory."""
    begun = time.perf_counter()
    lowered = jax.jit(function).lower(*inputs)
    traced = time.perf_counter()
    program = lowered.compile()
    done = time.perf_counter()
    memory = program.memory_analysis()
    cost = {
        "trace_s": traced - begun,
        "compile_s": done - traced,
        "memory_mib": getattr(memory, "temp_size_in_bytes", math.nan) / 2**20,
    }
    return program, cost


def in_turn(
    functions: dict[str, Callable[[], Any]], repeats: int
) -> dict[str, list[float]]:
    """Seconds of each function, run one after the other, `repeats` rounds."""
    for function in functions.values():
        jax.block_until_ready(function())
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            begun = time.perf_counter()
            jax.block_until_ready(function())
            seconds[name].append(time.perf_counter() - begun)
    return seconds


def median_ratio(above: Sequence[float], below: Sequence[float]) -> float:
    """Median of the quotients, round by round."""
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


def spread_of(seconds: Sequence[float]) -> float:
    """Slowest over fastest."""
    return max(seconds) / min(seconds)


def machine() -> str:
    """Processor, cores and versions, in a line."""
    about = provenance()
    hardware = about["hardware"]
    return f"{hardware['processor']}, {CORES} cores, jax {about['versions']['jax']}"


def figure(value: Any) -> str:
    """A number in a table, with three digits; a dash where there is none."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, str | int):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def markdown(titles: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table: the first column left, the others right."""
    lines = [
        "| " + " | ".join(titles) + " |",
        "|---|" + "---:|" * (len(titles) - 1),
        *("| " + " | ".join(figure(cell) for cell in row) + " |" for row in rows),
    ]
    return "\n".join(lines)


def drawing(panels: int) -> tuple[Figure, Any]:
    """A figure with panels side by side."""
    matplotlib.rcdefaults()
    whole = Figure(figsize=(3.6 * panels, 3.2), layout="constrained")
    return whole, whole.subplots(1, panels, squeeze=False)[0]


def label_sizes(panel: Any, sizes: Sequence[int]) -> None:
    """Name exactly these sizes on a logarithmic horizontal axis."""
    panel.set_xticks(sizes, [str(size) for size in sizes])
    panel.minorticks_off()


def fitted(rows: Sequence[dict[str, Any]], size: str, cost: str) -> float | None:
    """p of cost ∝ size^p by least squares in logarithms; None for one size alone."""
    sizes, costs = ([row[key] for row in rows] for key in (size, cost))
    if len(set(sizes)) < 2:
        return None
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def save(whole: Figure, title: str, path: Path) -> None:
    """Name the machine and write the picture."""
    whole.suptitle(f"{title}\n{machine()}", fontsize=8)
    with replacing(path) as temporary:
        whole.savefig(temporary, dpi=200)


def conclude(options: argparse.Namespace, result: dict[str, Any], table: str) -> None:
    """Print the figures as JSON or as tables."""
    if options.json:
        settings = {
            k: str(v) if isinstance(v, Path) else v for k, v in vars(options).items()
        }
        about = provenance(settings=settings, available_cores=CORES)
        print(json.dumps({**result, "provenance": about}, indent=2))
    else:
        print(f"{machine()}, float{options.precision}\n\n{table}")
