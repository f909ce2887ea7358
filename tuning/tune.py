"""The command that tunes: descend, keep the best, write the gains."""

import argparse
import csv
import io
import json
import sys
import time
from operator import attrgetter
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import tomli_w

from jaxglider import paper
from jaxglider.config import load_gains
from jaxglider.gains import encode
from jaxglider.io import metrics_dict, provenance, write_text
from jaxglider.metrics import Metrics
from jaxglider.rollout import ClosedLoop, evaluate
from jaxglider.vehicle.plant import SmallAnglePlant
from tuning.descent import Settings, Step, descend, make_gradient
from tuning.objective import RelativeTracking
from tuning.progress import Progress, note
from tuning.runs import check_writable
from tuning.space import PositiveGains

OK, RUN_FAILED, INTERRUPTED = 0, 1, 130


def tune(options: argparse.Namespace) -> int:
    """`jaxglider tune`: k₁ and k₂ of FxTPPC by gradient descent."""
    settings = Settings(
        steps=options.steps, learning_rate=options.learning_rate, seed=options.seed
    )
    check_writable(options.out)
    loop = _starting_loop(options)
    sea = loop.scenario.sea(jax.random.key(0))
    space = PositiveGains()
    start = space.read(loop.controller)
    progress, begun = Progress(), time.monotonic()
    progress.show("compiling the rollout ...")
    run = jax.jit(evaluate)
    before = jax.device_get(run(loop, sea))
    if not before.finite:
        raise FloatingPointError(
            "the starting gains do not complete the run; start from others (--gains)."
        )
    objective = RelativeTracking.of(before)
    progress.show("compiling the gradient ...")

    def loss(free: Any) -> Any:
        tried = eqx.tree_at(
            lambda at: at.controller, loop, space.write(loop.controller, free)
        )
        return objective(tried, sea)

    history, interrupted = _descend(loss, start, settings, progress)
    best = min((s for s in history if not s.refused), key=lambda s: s.loss)
    tuned = eqx.tree_at(
        lambda at: at.controller, loop, space.write(loop.controller, best.free)
    )
    after = jax.device_get(run(tuned, sea))
    result = {
        "scenario": options.scenario,
        "plant": options.plant,
        "steps": len(history) - 1,
        "refused": sum(s.refused for s in history),
        "seconds": round(time.monotonic() - begun, 1),
        "objective": {"before": 3.0, "after": _objective(before, after)},
        "gains": {p: float(attrgetter(p)(tuned.controller)) for p in space.paths},
        "before": metrics_dict(before, has_waypoints=_has_waypoints(loop)),
        "after": metrics_dict(after, has_waypoints=_has_waypoints(loop)),
        "provenance": provenance(
            command=sys.argv[1:], precision=options.precision, partial=interrupted
        ),
    }
    _write(options.out, tuned, history, space, result)
    if options.json:
        json.dump(result, sys.stdout, indent=2, allow_nan=False)
        sys.stdout.write("\n")
    else:
        sys.stdout.write(_table(result) + "\n")
    note(f"{options.out}: gains.toml and history.csv.")
    return INTERRUPTED if interrupted else OK


def _starting_loop(options: argparse.Namespace) -> ClosedLoop:
    setting = paper.make_scenario(
        options.scenario, options.plant, dt=options.dt, duration=options.duration
    )
    assert isinstance(setting.plant, SmallAnglePlant)
    model = paper.design_model(setting.plant)
    if options.gains is None:
        controller = paper.make_controller("fxtppc", options.scenario, model)
        return ClosedLoop(setting, controller, paper.make_observer("fxtppc", model))
    _, controller, observer = load_gains(options.gains, options.scenario, model)
    return ClosedLoop(setting, controller, observer)


def _descend(
    loss: Any, start: Any, settings: Settings, progress: Progress
) -> tuple[list[Step], bool]:
    """Descend to the end or to an interruption; what was reached is kept."""
    history: list[Step] = []
    begun = time.monotonic()
    try:
        for step in descend(make_gradient(loss, settings), start, settings):
            if not history:
                begun = time.monotonic()
            history.append(step)
            best = min(s.loss for s in history if not s.refused)
            pace = (time.monotonic() - begun) / max(step.number, 1)
            progress.show(
                f"step {step.number}/{settings.steps}  objective {step.loss:.4f}  "
                f"best {best:.4f}  {'refused  ' if step.refused else ''}"
                f"{pace * (settings.steps - step.number):.0f} s left"
            )
    except KeyboardInterrupt:
        if not history:
            raise
        note("interrupted; keeping the best gains so far.")
        return history, True
    finally:
        progress.clear()
    return history, False


def _objective(before: Metrics, after: Metrics) -> float:
    ratios = [
        float(getattr(after.channels, c).rms_error)
        / float(getattr(before.channels, c).rms_error)
        for c in ("depth", "pitch", "heading")
    ]
    return sum(ratios)


def _has_waypoints(loop: ClosedLoop) -> bool:
    return loop.scenario.reference.can_finish


def _write(
    out: Path,
    tuned: ClosedLoop,
    history: list[Step],
    space: PositiveGains,
    result: dict[str, Any],
) -> None:
    about = {
        "command": "jaxglider " + " ".join(result["provenance"]["command"]),
        "created": result["provenance"]["created"],
        "scenario": result["scenario"],
        "plant": result["plant"],
        "objective_before": result["objective"]["before"],
        "objective_after": result["objective"]["after"],
        "versions": result["provenance"]["versions"],
    }
    gains = {
        "format": 1,
        "controller": encode(tuned.controller),
        "observer": encode(tuned.observer),
        "provenance": about,
    }
    write_text(out / "gains.toml", tomli_w.dumps(gains))
    table = io.StringIO()
    rows = csv.writer(table)
    rows.writerow(["step", "objective", "refused", "learning_rate", *space.paths])
    for step in history:
        rows.writerow(
            [
                step.number,
                step.loss,
                int(step.refused),
                step.learning_rate,
                *np.exp(np.asarray(step.free)).tolist(),
            ]
        )
    write_text(out / "history.csv", table.getvalue())


def _table(result: dict[str, Any]) -> str:
    units = {"depth": "m", "pitch": "rad", "heading": "rad"}
    measures = {"rms_error": "L2[e]", "rms_effort": "L2[U]", "chattering": "chatter"}
    lines = [
        f"{result['scenario']} on {result['plant']}: objective 3 -> "
        f"{result['objective']['after']:.4f} in {result['steps']} steps, "
        f"{result['seconds']:.0f} s",
        f"{'':<16}" + "".join(f"{m:>22}" for m in measures.values()),
    ]
    for channel, unit in units.items():
        cells = ""
        for key in (*measures, "time_outside_funnel")[:3]:
            old = result["before"]["channels"][channel][key]
            new = result["after"]["channels"][channel][key]
            cells += f"{f'{old:.4f} -> {new:.4f}':>22}"
        lines.append(f"{f'{channel} [{unit}]':<16}{cells}")
    lines += [f"{path:<20}{value:>12.5g}" for path, value in result["gains"].items()]
    return "\n".join(lines)
