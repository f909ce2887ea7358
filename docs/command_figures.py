"""Figures of tune, sweep, trim, fit and record, of what these found once."""

import csv
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from recording import keep, kept

import tuning
from jaxglider import paper
from jaxglider.plotting.glide import glide_figure
from jaxglider.signals import CHANNELS, Command, GliderState
from jaxglider.trim.linear_model import INPUTS, linearise
from jaxglider.trim.modes import Analysis, Mode, analyse
from jaxglider.trim.steady_motion import SteadyMotion, Target, steady_motion
from jaxglider.vehicle.published import load_vehicle
from tuning.campaign.analysis.rank_correlations import SEVERITY
from tuning.campaign.analysis.ribbons import Ribbons, ribbons
from tuning.campaign.analysis.summary import CampaignSummary, ControllerSummary
from tuning.campaign.report.draw import campaign_figures
from tuning.campaign.report.levels import level_figures
from tuning.campaign.run.rows import Rows
from tuning.evaluation.figures import gains_of, tuning_figures
from tuning.identification.record.reading import read_record
from tuning.identification.report.figures import fit_figure, residuals_figure
from tuning.identification.report.record_figure import record_figure
from tuning.reporting.tables import headline
from tuning.search.settings import Step

HERE = Path(__file__).parent
RECORDED = HERE / "recorded"
FLIGHT_RECORD = HERE / "examples" / "records" / "comet-2016.csv"
_CASE = ("switching", "SeaWing", "rigid-body")
_LEVELS = (0.1, 0.3)
_SHOWN, _THIN = 16, 4
"""Members behind a ribbon, and points from one that is kept to the next."""


def command_figures() -> Iterator[tuple[str, Figure]]:
    """Name and figure, one at a time."""
    for command in (_tune, _sweep, _trim, _fit):
        yield from command()


def record_commands() -> None:
    """Tune, sweep, trim and fit, and keep what figures are drawn of."""
    for command in (record_tune, record_sweep, record_trim, record_fit):
        command()


def record_tune() -> None:
    """Ten steps of a PID on two members."""
    loop = paper.make_loop("switching", "rigid-body", "pid", duration=100.0)
    few = {"members": 2, "validation": 2, "test": 2}
    result = tuning.tune(loop, **few, steps=10, check=False, progress=False)
    gains = gains_of(result.problem, result.history)
    with (RECORDED / "tune.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["number", "loss", "validation", "refused", *gains])
        for n, s in enumerate(result.history):
            numbers = (s.loss, s.validation, *(of[n] for of in gains.values()))
            words = [f"{float(x):.8g}" for x in numbers]
            rows.writerow([s.number, *words[:2], int(s.refused), *words[2:]])
    for name, run in result.trajectories().items():
        ticks = jax.tree.map(lambda x: x[::10], run.ticks)
        keep(RECORDED / f"tune-{name}.npz", dataclasses.replace(run, ticks=ticks))


def _tune() -> Iterator[tuple[str, Figure]]:
    with (RECORDED / "tune.csv").open(encoding="utf-8", newline="") as file:
        names, *rows = list(csv.reader(file))
    table = {n: [float(row[k]) for row in rows] for k, n in enumerate(names)}
    head = [table.pop(n) for n in ("number", "loss", "validation", "refused")]
    history = [
        Step(int(number), loss, validation, jnp.zeros(0), bool(refused), False, 0.1)
        for number, loss, validation, refused in zip(*head, strict=True)
    ]
    runs = {name: kept(RECORDED / f"tune-{name}.npz") for name in ("before", "after")}
    title = f"{headline(*_CASE)}, PID"
    for name, figure in tuning_figures(title, history, table, runs):
        yield f"tune/{name}", figure


def record_sweep() -> None:
    """Two laws on 64 members at two levels, the second with sensitivities."""
    loops = {
        law: paper.make_loop("switching", "rigid-body", law, duration=100.0)
        for law in ("smc", "pid")
    }
    arrays: dict[str, np.ndarray] = {}
    told = []
    for level in _LEVELS:
        result = tuning.sweep(
            loops,
            uncertainty=level,
            members=64,
            sensitivity=64 if level == _LEVELS[-1] else 0,
            progress=False,
        )
        told.append(_plain(result.summary))
    arrays["rows"] = np.array(result.rows.rows)
    for number, of in enumerate(result.summary.controllers.values()):
        seen = ribbons(result.campaign, number, _SHOWN, of.worst_member)
        arrays[f"{number}.time"] = seen.time[::_THIN]
        for channel in CHANNELS:
            arrays[f"{number}.{channel}.errors"] = seen.errors[channel][:, ::_THIN]
            arrays[f"{number}.{channel}.worst"] = seen.worst[channel][::_THIN]
            edges = np.stack(seen.edges[channel])[:, ::_THIN]
            arrays[f"{number}.{channel}.edges"] = edges
    single = {
        key: value if key == "rows" else value.astype(np.float32)
        for key, value in arrays.items()
    }
    np.savez_compressed(RECORDED / "sweep.npz", **single)
    uncertainty = result.campaign.uncertainty
    units = [q.unit for q in uncertainty.quantities]
    content = {
        "units": dict(zip(uncertainty.names(), units, strict=True)),
        "levels": told,
    }
    (RECORDED / "sweep.json").write_text(json.dumps(content) + "\n", encoding="utf-8")


def _plain(summary: CampaignSummary) -> dict[str, Any]:
    """What figures are drawn of, and nothing else that a summary says."""
    table = summary.to_dict()
    for controller in table["controllers"].values():
        controller["measures"] = controller["ledger"] = {}
        ranked = controller["rank_correlations"][SEVERITY]
        controller["rank_correlations"] = {SEVERITY: ranked}
        for one in controller.get("sensitivity", {}).values():
            del one["disagreements"]
            one["rows"] = one["rows"][:8]
    named = dict(zip(("scenario", "vehicle", "plant"), _CASE, strict=True))
    return {**table, **named, "paired": [], "provenance": {}}


def _sweep() -> Iterator[tuple[str, Figure]]:
    content = json.loads((RECORDED / "sweep.json").read_text(encoding="utf-8"))
    summaries = [_summary(table) for table in content["levels"]]
    with np.load(RECORDED / "sweep.npz") as file:
        arrays = dict(file)
    labels = tuple(summaries[-1].controllers)
    shown = [
        Ribbons(
            arrays[f"{n}.time"],
            {c: arrays[f"{n}.{c}.errors"] for c in CHANNELS},
            {c: tuple(arrays[f"{n}.{c}.edges"]) for c in CHANNELS},
            {c: arrays[f"{n}.{c}.worst"] for c in CHANNELS},
        )
        for n in range(len(labels))
    ]
    table = Rows(arrays["rows"], labels)
    drawn = campaign_figures(content["units"], table, summaries[-1], shown)
    for name, figure in (*drawn, *level_figures(summaries, None)):
        yield f"sweep/{name}", figure


def _summary(table: dict[str, Any]) -> CampaignSummary:
    controllers = {
        label: ControllerSummary(**of) for label, of in table["controllers"].items()
    }
    return CampaignSummary(**{**table, "controllers": controllers})


def record_trim() -> None:
    """A steady spiral of SeaWing."""
    vehicle = load_vehicle("seawing")
    plant = paper.PLANTS["seawing"](vehicle)
    target = Target(buoyancy_mass=0.3, mass_position=0.02, mass_angle=-0.5)
    motion = jax.jit(steady_motion)(plant, target)
    linear = jax.jit(linearise)(plant, motion)
    limits = np.array([float(getattr(vehicle.limits, name)) for name in INPUTS])
    analysis = analyse(np.asarray(linear.a), np.asarray(linear.b), limits)
    modes = [
        [m.eigenvalue.real, m.eigenvalue.imag, m.lateral, *m.reach, m.distance]
        for m in analysis.modes
    ]
    content = {
        "state": {k: float(v) for k, v in vars(motion.state).items()},
        "command": {k: float(v) for k, v in vars(motion.command).items()},
        "modes": np.array(modes).tolist(),
    }
    (RECORDED / "trim.json").write_text(json.dumps(content) + "\n", encoding="utf-8")


def _trim() -> Iterator[tuple[str, Figure]]:
    content = json.loads((RECORDED / "trim.json").read_text(encoding="utf-8"))
    state, command = GliderState(**content["state"]), Command(**content["command"])
    zero = jnp.zeros(())
    motion = SteadyMotion(state, command, zero, zero, jnp.asarray(True))
    modes = tuple(
        Mode(complex(m[0], m[1]), m[2], tuple(m[3:6]), m[6]) for m in content["modes"]
    )
    vehicle = load_vehicle("seawing")
    plant = paper.PLANTS["seawing"](vehicle)
    analysis = Analysis(modes, 0, 0)
    yield "trim/trim", glide_figure(vehicle, plant, motion, analysis, "seawing")


_FLIGHT = ("time", "depth", "depth_rate", "pitch", "dive", "good")


def record_fit() -> None:
    """A Slocum fitted to its record."""
    result = tuning.fit(FLIGHT_RECORD)
    fit, verdict = result.fit, result.verdict
    held = np.isin(fit.flight.dive, fit.plan.held_out)
    arrays = {name: np.asarray(getattr(fit.flight, name))[held] for name in _FLIGHT}
    arrays["time"] = arrays["time"] - arrays["time"][0]
    for part in ("measured", "before", "after"):
        for name, values in getattr(verdict, part).items():
            arrays[f"{part}.{name}"] = np.asarray(values, np.float32)[held]
    arrays["held_out"] = np.asarray(fit.plan.held_out)
    arrays["scores"] = np.array(list(verdict.scores))
    arrays["dt"] = np.asarray(fit.flight.dt)
    np.savez_compressed(RECORDED / "fit.npz", **arrays)


def _fit() -> Iterator[tuple[str, Figure]]:
    with np.load(RECORDED / "fit.npz") as file:
        arrays = dict(file)
    flight = SimpleNamespace(
        dt=float(arrays["dt"]), **{name: arrays[name] for name in _FLIGHT}
    )
    plan = SimpleNamespace(kind="driven", held_out=tuple(arrays["held_out"].tolist()))
    vehicle = SimpleNamespace(name=load_vehicle("slocum").name)
    fit: Any = SimpleNamespace(flight=flight, plan=plan, vehicle=vehicle)
    parts = {
        part: {
            key.removeprefix(f"{part}."): values
            for key, values in arrays.items()
            if key.startswith(f"{part}.")
        }
        for part in ("measured", "before", "after")
    }
    scores = dict.fromkeys(arrays["scores"].tolist())
    verdict: Any = SimpleNamespace(scores=scores, **parts)
    yield "fit/fit", fit_figure(fit, verdict)
    yield "fit/residuals", residuals_figure(fit, verdict)
    yield "record/record", record_figure(read_record([FLIGHT_RECORD]))
