"""Every law tuned alike, and who wins: `python benchmarks/bench_laws.py --out FOLDER`.

Each law of the catalogue is tuned by gradient from the gains that it begins with, on
the same budget, for one and the same cost on the same gliders and seas, and judged on
others, again the same for all. The cost is that of `jaxglider tune`, but relative to
fixed numbers instead of to the start of each law. `--keep` goes on where a run was
stopped: a law whose file is there is not tuned again. FOLDER gets a file of gains and
one of figures for each law, `laws.md` and `laws.png`. FxTPPC-roll is left out: made for
actuators that jump.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import jaxglider

jaxglider.enable_fast_loops()

import jax
import jax.numpy as jnp
import numpy as np
import tomli_w

from jaxglider.control.catalogue import BY_NAME
from jaxglider.files.gains import encode_gains
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.plotting.save import save
from jaxglider.plotting.style import look, new_figure
from jaxglider.signals import CHANNELS
from tuning.cli.options.arguments import CONTROLLERS, PLANTS, SCENARIOS
from tuning.cli.session.jax_setup import start_jax
from tuning.problem.objective import Weights
from tuning.problem.objective_file import DEFAULT_WEIGHTS
from tuning.problem.problem import TuningProblem, assess_members
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.console import SilentProgress
from tuning.reporting.statistics import clopper_pearson, paired_difference
from tuning.search.descend import descend
from tuning.search.settings import DescentSettings

LAWS = tuple(name for name in CONTROLLERS if name != "fxtppc-roll")
PAPER_LAWS = ("smc", "ppc", "fxtppc")
SCALES = {
    # measure: depth, pitch, heading
    "rms_error": (0.15, 0.06, 0.3),
    "chattering": (2e-4, 4e-5, 3e-3),
    "travel": (1.0, 0.15, 25.0),
}
"""What counts as one: about what the paper's laws come to in `switching`."""


def cost(metrics: Any, start: Any) -> Any:
    """The weights of `jaxglider tune`, each measure over its fixed scale."""
    weights: Weights = DEFAULT_WEIGHTS
    roll = jnp.maximum(metrics.max_roll - 0.785, 0.0)
    total = weights.roll * roll * roll
    for number, channel in enumerate(CHANNELS):
        of = getattr(metrics.channels, channel)
        total += weights.tracking[number] * of.rms_error / SCALES["rms_error"][number]
        total += weights.chattering * of.chattering / SCALES["chattering"][number]
        total += weights.travel * of.travel / SCALES["travel"][number]
        total += weights.crowding * of.funnel_crowding
        total += weights.saturation * of.saturation_excess
    return total


def main() -> int:
    options = _parser().parse_args()
    start_jax(32, every_core=True)
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for law in options.laws:
        file = options.out / f"{law}.json"
        if not (options.keep and file.is_file()):
            sys.stderr.write(f"{law} ...\n")
            write_json(file, _tuned(law, options))
        results.append(json.loads(file.read_text(encoding="utf-8")))
    text = table(results)
    write_text(options.out / "laws.md", text)
    with look():
        save(_figure(results), options.out / "laws.png")
    sys.stdout.write(text)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/laws"))
    parser.add_argument("--scenario", choices=SCENARIOS, default="switching")
    parser.add_argument("--plant", choices=PLANTS, default="rigid-body")
    parser.add_argument("--laws", nargs="+", choices=LAWS, default=LAWS, metavar="LAW")
    parser.add_argument("--members", type=int, default=32)
    parser.add_argument("--test", type=int, default=64)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--duration", type=float)
    parser.add_argument("--keep", action="store_true")
    return parser


def _tuned(law: str, options: argparse.Namespace) -> dict[str, Any]:
    """One law tuned, and what it is worth before and after."""
    ensemble = EnsembleSpec(
        training=options.members, validation=options.members, test=options.test
    )
    spec = ProblemSpec.of_paper(
        options.scenario,
        options.plant,
        law,
        duration=options.duration,
        ensemble=ensemble,
        cost=cost,
    )
    begun = time.process_time()
    problem = TuningProblem.of(spec)
    settings = DescentSettings(steps=options.steps)
    found = descend(problem, settings, SilentProgress(), check=False)
    # By way of the host, off all devices but one.
    free = jnp.asarray(jax.device_get(found.free))
    tuned = problem.space.write(problem.loop, free)
    spent = time.process_time() - begun
    loops = {"start": problem.loop, "tuned": tuned}
    judged = {
        name: jax.device_get(assess_members(loop, problem.test)[0])
        for name, loop in loops.items()
    }
    about = provenance(
        command=" ".join(["python", *sys.argv]), scenario=options.scenario
    )
    about["plant"] = options.plant
    gains = encode_gains(tuned.controller, tuned.observer, None)
    text = tomli_w.dumps(gains | {"provenance": about})
    write_text(options.out / f"{law}.toml", text)
    memory = jax.eval_shape(tuned.controller.on_board().init)
    return {
        "law": law,
        "numbers": len(problem.space.names),
        "state_bytes": sum(8 * x.size for x in jax.tree.leaves(memory)),
        "seconds": spent,
        "remarks": list(found.remarks),
        "scenario": options.scenario,
        "plant": options.plant,
        "budget": f"{options.steps} steps on {options.members} members",
        **{name: _figures(metrics) for name, metrics in judged.items()},
    }


def _figures(metrics: Any) -> dict[str, Any]:
    """What the table needs of each member."""
    finite = np.asarray(metrics.finite)
    costs = np.asarray(jax.vmap(lambda m: cost(m, m))(metrics), float)
    good = finite & np.isfinite(costs)
    channels = {
        name: {
            measure: np.asarray(getattr(of, measure), float).tolist()
            for measure in ("rms_error", "travel", "funnel_peak")
        }
        for name, of in ((n, getattr(metrics.channels, n)) for n in CHANNELS)
    }
    return {
        "good": good.tolist(),
        "cost": np.where(good, costs, 1e9).tolist(),
        "capsized": np.asarray(metrics.capsized).tolist(),
        "channels": channels,
    }


def table(results: list[dict[str, Any]]) -> str:
    """The laws by their cost, who wins first.

    Args:
        results: what `_tuned` gave for each law.
    """
    ranked = sorted(results, key=lambda r: (_failed(r), _mean_cost(r)))
    best = ranked[0]
    lines = [_headline(ranked), ""]
    lines += [
        f"{best['scenario']} on {best['plant']}, each law {best['budget']}, judged on "
        f"{len(best['tuned']['good'])} others, the same for all; start → tuned.",
        "",
        "| law | numbers | cost | more than the first, 95 % | change by tuning, 95 % | "
        "depth [m] | pitch [rad] | heading [rad] | pump [kg] | mass [m] | angle [rad] "
        "| left a funnel | past 90° or lost | memory [B] |",
        "|---|---:|---:|---|---|---:|---:|---:|---:|---:|---:|---|---|---:|",
    ]
    lines += [_row(result, best) for result in ranked]
    return "\n".join(lines) + "\n"


def _row(result: dict[str, Any], best: dict[str, Any]) -> str:
    start, tuned = result["start"], result["tuned"]
    cells = [BY_NAME[result["law"]].label, str(result["numbers"])]
    cells.append(f"{_mean(start['cost'], start):.3g} → {_mean_cost(result):.3g}")
    cells.append("–" if result is best else _interval(_costs(best), _costs(result)))
    cells.append(_interval(_costs(result, "start"), _costs(result)))
    for channel in CHANNELS:
        pair = [_mean(x["channels"][channel]["rms_error"], x) for x in (start, tuned)]
        cells.append(" → ".join(f"{x:.3g}" for x in pair))
    for channel in CHANNELS:
        cells.append(f"{_mean(tuned['channels'][channel]['travel'], tuned):.3g}")
    peaks = [tuned["channels"][c]["funnel_peak"] for c in CHANNELS]
    cells.append(_share(np.max(peaks, axis=0) > 1.0))
    cells.append(_share(np.asarray(tuned["capsized"]) | ~np.asarray(tuned["good"])))
    return "| " + " | ".join([*cells, str(result["state_bytes"])]) + " |"


def _headline(ranked: list[dict[str, Any]]) -> str:
    """Who wins, and by how much over the best law of the paper."""
    best = ranked[0]
    label = BY_NAME[best["law"]].label
    name = f"**{label} wins**"
    papers = [r for r in ranked if r["law"] in PAPER_LAWS]
    others = [r for r in ranked if r["law"] not in PAPER_LAWS]
    if not papers or not others:
        return f"{name}."
    rival = others[0] if best["law"] in PAPER_LAWS else papers[0]
    whose = "other law" if best["law"] in PAPER_LAWS else "law of the paper"
    first, second = _costs(best), _costs(rival)
    interval = paired_difference(first, second)["interval"]
    if interval is not None and interval[0] <= 0.0:
        name = f"**{label} is first, and not told from the best {whose}**"
    return (
        f"{name}: {BY_NAME[rival['law']].label} costs {_interval(first, second)} more, "
        f"{_mean_cost(rival):.3g} against {_mean_cost(best):.3g}."
    )


def _costs(result: dict[str, Any], when: str = "tuned") -> np.ndarray:
    costs = np.asarray(result[when]["cost"])
    return np.where(np.asarray(result[when]["good"]), costs, np.inf)


def _failed(result: dict[str, Any]) -> int:
    return int(np.sum(~np.asarray(result["tuned"]["good"])))


def _mean(values: list[float], of: dict[str, Any]) -> float:
    good = np.asarray(of["good"])
    return float(np.asarray(values)[good].mean()) if good.any() else float("nan")


def _mean_cost(result: dict[str, Any]) -> float:
    return _mean(result["tuned"]["cost"], result["tuned"])


def _interval(first: np.ndarray, second: np.ndarray) -> str:
    pairs = paired_difference(first, second)
    if pairs["interval"] is None:
        return "–"
    low, high = pairs["interval"]
    return f"{pairs['difference']:.2g} [{low:.2g}, {high:.2g}]"


def _share(events: Any) -> str:
    k, n = int(np.sum(events)), len(events)
    low, high = clopper_pearson(k, n)
    return f"{k}/{n} [{low:.2f}, {high:.2f}]"


def _figure(results: list[dict[str, Any]]) -> Any:
    """Error of the heading against the way of the mass angle, start to tuned."""
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    for result in results:
        places = [
            [
                _mean(result[when]["channels"]["heading"][measure], result[when])
                for measure in ("travel", "rms_error")
            ]
            for when in ("start", "tuned")
        ]
        (x0, y0), (x1, y1) = places
        axes.plot([x0, x1], [y0, y1], color="0.8", linewidth=0.8, zorder=1)
        paper = result["law"] in PAPER_LAWS
        axes.plot(x1, y1, "o" if paper else "s", color="C0" if paper else "C1")
        axes.annotate(
            BY_NAME[result["law"]].label,
            (x1, y1),
            xytext=(4, 3),
            textcoords="offset points",
            fontsize=7,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(x=0.15, y=0.08)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("{x:g}")
    axes.set_xlabel("way of the mass angle [rad], tuned; lines from the start")
    axes.set_ylabel("L2 of the heading error [rad]")
    return figure


if __name__ == "__main__":
    sys.exit(main())
