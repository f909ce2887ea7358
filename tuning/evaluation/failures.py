"""Failed runs: cut where they fail, recorded tick by tick until then, and explained."""

import argparse
import dataclasses
import math
import shlex
from typing import Any

import jax

from jaxglider.core.containers import Series
from jaxglider.signals import BodyAxes
from jaxglider.simulation.checks.failure import Failure, explain
from jaxglider.simulation.checks.past import before, first_nonsense
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory, simulate, with_ticks

MOST_TICKS = 1_000_000
"""Ticks that are recorded one by one of a run that failed: about 1 GB."""


def until_failure(
    loop: ClosedLoop,
    sea: BodyAxes[Series],
    run: Trajectory,
    keep_every: int = 1,
    simulation: Any = None,
    noise: Any = None,
) -> tuple[Trajectory, Failure | None]:
    """A run as it is if all went well, else every tick until its failure, and why.

    A run of which every nth tick was recorded is flown again until there.

    Args:
        loop: closed loop that was flown.
        sea: realised disturbance of the run.
        run: trajectory on the host.
        keep_every: ticks from one record to the next.
        simulation: compiled `simulate` that keeps every tick; made if it is needed.
        noise: realised errors of the sensors, or None.
    """
    if keep_every > 1:
        clock = loop.scenario.clock
        culprit = first_nonsense(run, clock.ticks * float(clock.dt))
        if culprit is None:
            return run, None
        ticks = min(culprit.tick * keep_every + 1, clock.ticks)
        if ticks > MOST_TICKS:
            failure = explain(loop, run)
            return before(run, culprit.tick), failure
        metrics = run.metrics
        brief = with_ticks(loop, ticks)
        part = jax.tree.map(lambda x: x[: ticks + 1], (sea, noise))
        again = simulation or jax.jit(simulate)
        run = dataclasses.replace(jax.device_get(again(brief, *part)), metrics=metrics)
    failure = explain(loop, run)
    if failure is None:
        return run, None
    return before(run, max(failure.culprit.tick, 1)), failure


def command_that_shows(options: argparse.Namespace, run: dict[str, Any]) -> str:
    """The command that flies a failed run again until a little after its failure.

    Args:
        options: options of the command that flew it.
        run: summary of the run.
    """
    duration = f"--duration {math.ceil(run['failure']['time_s']) + 1}"
    if options.command == "compare" and options.config is None:
        words = [
            *("jaxglider compare --scenario", run["scenario"]),
            *("--plant", run["plant"], "--controllers", run["controller"].split()[0]),
        ]
        for name in ("dt", "actuators"):
            if getattr(options, name) is not None:
                words += [f"--{name}", str(getattr(options, name))]
        if options.gains:
            words += ["--gains", *map(shlex.quote, options.gains)]
    else:
        words = ["jaxglider simulate", shlex.quote(str(options.config))]
        if getattr(options, "seed", None) is not None:
            words += ["--seed", str(options.seed)]
        law = run["controller"].split()[0]
        if options.command == "compare" or options.controller is not None:
            words += ["--controller", shlex.quote(law)]
    return " ".join([*words, duration, "--out", f"{options.out}-failed"])
