"""What each constraint costs: `python benchmarks/bench_constraints.py`.

Tunes FxTPPC for a case of the paper, on actuators as fast as the vehicle's file says,
with all constraints of `jaxglider tune` held, with each let go alone, and with none
held: from the same start, on the same gliders and seas. Prints L2[e] on the same
held-out members, the heading paired with that of all held, and what became of the
constraints: the largest P/P_spec of any channel and time, the longest settling time of
a surface over the required one, the fastest growing motion on the task's glides.
"""

import argparse
import dataclasses
import sys
from typing import Any, NamedTuple

import jaxglider

jaxglider.enable_fast_loops()

import jax
import jax.numpy as jnp
import numpy as np
from law_cases import paper_case

from jaxglider.control import tian_exponents
from jaxglider.signals import CHANNELS
from jaxglider.simulation.checks.stability import glides_of, loop_modes
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning import tune
from tuning.cli.options.arguments import PLANTS, SCENARIOS
from tuning.cli.session.jax_setup import start_jax
from tuning.problem.problem import assess_members
from tuning.reporting.statistics import paired_difference
from tuning.space.prescribed import ERROR
from tuning.space.space import HELD_BY_DEFAULT

TIMES = np.linspace(0.0, 1000.0, 20001)
"""Times since the restart of a funnel that P and P_spec are compared at [s]."""


class Tuned(NamedTuple):
    """What came of tuning under some constraints.

    Attributes:
        words: constraints that were let go.
        loop: closed loop with the tuned gains.
        metrics: metrics of the held-out members, on the host.
        steps: number of steps made.
    """

    words: str
    loop: ClosedLoop
    metrics: Any
    steps: int


def main() -> int:
    options = _parser().parse_args()
    start_jax(64, every_core=True)
    loop = paper_case(options.scenario, options.plant, None, None).loop("fxtppc")
    held = [name for name in HELD_BY_DEFAULT if name != ERROR]
    rows = _table(
        [_tuned(loop, "none", held, options)]
        + [
            _tuned(loop, f"`{name}`", [one for one in held if one != name], options)
            for name in held
        ]
        + [_tuned(loop, "all", [], options)]
    )
    if options.tian:
        law = dataclasses.replace(loop.controller, exponents=tian_exponents)
        tian = dataclasses.replace(loop, controller=law)
        words = "none, Tian's pairing", f"`{ERROR}`, Tian's pairing"
        rows += [
            "",
            *_table(
                [
                    _tuned(tian, words[0], HELD_BY_DEFAULT, options),
                    _tuned(tian, words[1], held, options),
                ]
            ),
        ]
    sys.stdout.write("\n".join(rows) + "\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", choices=SCENARIOS, default="switching")
    parser.add_argument("--plant", choices=PLANTS, default="rigid-body")
    parser.add_argument("--members", type=int, default=32)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--tian", action="store_true", help="Tian's pairing as well")
    return parser


def _tuned(
    loop: ClosedLoop, words: str, constraints: Any, options: argparse.Namespace
) -> Tuned:
    sys.stderr.write(f"let go: {words} ...\n")
    result = tune(
        loop,
        members=options.members,
        validation=options.members,
        steps=options.steps,
        constraints=tuple(constraints),
        check=False,
        progress=False,
    )
    metrics, _ = assess_members(result.loop, result.problem.test)
    steps = result.history[-1].number
    return Tuned(words, result.loop, jax.device_get(metrics), steps)


def _table(runs: list[Tuned]) -> list[str]:
    """Rows of a table; the first run is what the others are compared with."""
    heads = ["let go", "steps", "depth [m]", "pitch [rad]", "heading [rad]"]
    heads += ["heading more than with all held, 95 %", "left a specified funnel"]
    heads += ["past 90°", "P/P_spec", "settling/required", "growth [1/s]"]
    lines = ["| " + " | ".join(heads) + " |", "|---|" + "---:|" * (len(heads) - 1)]
    lines += ["| " + " | ".join(_cells(run, runs[0])) + " |" for run in runs]
    return lines


def _cells(run: Tuned, first: Tuned) -> list[str]:
    channels = run.metrics.channels
    cells = [run.words, str(run.steps)]
    cells += [f"{_error(run, c)[_good(run)].mean():.3g}" for c in CHANNELS]
    pairs = paired_difference(
        *(np.where(_good(x), _error(x, "heading"), np.inf) for x in (first, run))
    )
    interval = pairs["interval"]
    cells.append(
        "–"
        if run is first or interval is None
        else f"{pairs['difference']:.3f} [{interval[0]:.3f}, {interval[1]:.3f}]"
    )
    outside = sum(getattr(channels, c).time_outside_funnel > 0.0 for c in CHANNELS)
    cells += [str(int(np.sum(outside > 0))), str(int(np.sum(run.metrics.capsized)))]
    return [*cells, *(f"{x:.3g}" for x in _kept(run.loop))]


def _good(run: Tuned) -> np.ndarray:
    return np.asarray(run.metrics.finite)


def _error(run: Tuned, channel: str) -> np.ndarray:
    return np.asarray(getattr(run.metrics.channels, channel).rms_error)


def _kept(loop: ClosedLoop) -> tuple[float, float, float]:
    """Largest P/P_spec, settling time of a surface over the required, and growth."""
    law, specification = loop.controller, loop.scenario.specification
    own, specified = (
        jax.vmap(law.funnel.bounds)(TIMES),
        jax.vmap(specification.bounds)(TIMES),
    )
    width = max(
        float(jnp.max(getattr(own, c).value / getattr(specified, c).value))
        for c in CHANNELS
    )
    required = specification.required_settling()
    settling = max(
        float(getattr(law.gains, c).settling_bound() / getattr(required, c))
        for c in CHANNELS
    )
    modes = loop_modes(loop, glides_of(loop))
    return width, settling, max(one.growth for one in modes)


if __name__ == "__main__":
    sys.exit(main())
