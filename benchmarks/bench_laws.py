"""Every law tuned alike, and who wins: `python benchmarks/bench_laws.py --out FOLDER`.

Each law of the catalogue is tuned by gradient from the gains that it begins with, on
the same budget, for one and the same cost on the same gliders and seas, and judged on
others, again the same for all (`law_cases.py`). `--mission NAME` takes a mission of yos
that comes along; `--method cma` searches without gradients for what as many steps would
cost: where laws decide, and moves are counted, a gradient tells little. `--keep` goes
on where a run was stopped: a law whose file is there is not tuned again. FOLDER gets a
file of gains and one of figures for each law, `laws.md` and `laws.png`. FxTPPC-roll is
left out: made for actuators that jump.
"""

import argparse
import dataclasses
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
from law_cases import LawCase, mission_case, paper_case
from law_table import figure, table

from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.cost import cost_of
from jaxglider.files.flight.missions import mission_names
from jaxglider.files.gains import encode_gains
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.onboard.of_loop import autopilot
from jaxglider.plotting.save import save
from jaxglider.plotting.style import look
from tuning.cli.options.arguments import CONTROLLERS, PLANTS, SCENARIOS
from tuning.cli.session.jax_setup import start_jax
from tuning.problem.problem import TuningProblem, assess_members
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.console import SilentProgress
from tuning.search.black_box import search_black_box
from tuning.search.descend import SearchOutcome, descend
from tuning.search.settings import BlackBoxSettings, DescentSettings

LAWS = tuple(name for name in CONTROLLERS if name != "fxtppc-roll")


def main() -> int:
    options = _parser().parse_args()
    start_jax(32, every_core=True)
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for law in options.laws:
        file = options.out / f"{law}.json"
        if not (options.keep and file.is_file()):
            sys.stderr.write(f"{law} ...\n")
            sys.stderr.flush()
            write_json(file, _tuned(law, options))
        results.append(json.loads(file.read_text(encoding="utf-8")))
    text = table(results)
    write_text(options.out / "laws.md", text)
    with look():
        save(figure(results), options.out / "laws.png")
    sys.stdout.write(text)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/laws"))
    parser.add_argument("--scenario", choices=SCENARIOS, default="switching")
    parser.add_argument("--mission", choices=mission_names(), help="instead of a case")
    parser.add_argument("--method", choices=("descent", "cma"), default="descent")
    parser.add_argument("--plant", choices=PLANTS, default="rigid-body")
    parser.add_argument("--laws", nargs="+", choices=LAWS, default=LAWS, metavar="LAW")
    parser.add_argument("--members", type=int, default=32)
    parser.add_argument("--test", type=int, default=64)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--dt", type=float, help="control tick of a paper's case [s]")
    parser.add_argument("--duration", type=float)
    parser.add_argument("--keep", action="store_true")
    return parser


def _case(options: argparse.Namespace) -> LawCase:
    if options.mission:
        return mission_case(options.mission, options.duration)
    return paper_case(options.scenario, options.plant, options.dt, options.duration)


def _tuned(law: str, options: argparse.Namespace) -> dict[str, Any]:
    """One law tuned, and what it is worth before and after."""
    begun = time.process_time()
    case = _case(options)
    ensemble = EnsembleSpec(
        training=options.members, validation=options.members, test=options.test
    )
    spec = ProblemSpec(
        case.flight, law, case.loop(law), ensemble=ensemble, cost=case.cost
    )
    problem = TuningProblem.of(spec)
    settings = DescentSettings(steps=options.steps)
    try:
        found = _search(problem, settings, options.method)
        # By way of the host, off all devices but one.
        free = jnp.asarray(jax.device_get(found.free))
        tuned, remarks = problem.space.write(problem.loop, free), list(found.remarks)
    except (FloatingPointError, ValueError) as error:
        tuned, remarks = problem.loop, [f"not tuned: {error}"]
    judged = {
        name: _figures(case, jax.device_get(assess_members(loop, problem.test)[0]))
        for name, loop in {"start": problem.loop, "tuned": tuned}.items()
    }
    flight = case.flight
    about = provenance(command=" ".join(["python", *sys.argv]), scenario=flight.title)
    about["plant"] = flight.plant
    gains = encode_gains(tuned.controller, tuned.observer, None)
    text = tomli_w.dumps(gains | {"provenance": about})
    write_text(options.out / f"{law}.toml", text)
    return {
        "law": law,
        "numbers": len(problem.space.names),
        **_on_board(law, options),
        "remarks": remarks,
        "title": f"{flight.title} on {flight.plant}",
        "budget": f"{_budget(options)} on {options.members} members",
        "left": case.left and case.left[0],
        **judged,
        "processor_s": time.process_time() - begun,
    }


def _budget(options: argparse.Namespace) -> str:
    if options.method == "descent":
        return f"{options.steps} steps"
    return f"a search without gradients at the cost of {options.steps} steps"


def _search(
    problem: TuningProblem, settings: DescentSettings, method: str
) -> SearchOutcome:
    if method == "descent":
        return descend(problem, settings, SilentProgress(), check=False)
    first: tuple[str, ...] = ()
    if problem.starts_lost:
        # Far from gains that fly, a wide search tells first where some are.
        wide = BlackBoxSettings(method, spread=1.0)
        found = search_black_box(problem, wide, settings, SilentProgress())
        begun = problem.space.write(problem.loop, found.free)
        problem = dataclasses.replace(problem, loop=begun)
        first = ("lost at its start: searched twice, widely first.",)
    narrow = BlackBoxSettings(method)
    found = search_black_box(problem, narrow, settings, SilentProgress())
    return dataclasses.replace(found, remarks=(*first, *found.remarks))


def _on_board(law: str, options: argparse.Namespace) -> dict[str, Any]:
    """Estimated time of a tick in single precision, and the law's state in double."""
    with jax.enable_x64(True):
        pilot = autopilot(_case(options).loop(law))
        memory = jax.eval_shape(pilot.controller.init)
        cost = cost_of(autopilot_source(pilot, "benchmark"))
    held = sum(8 * x.size for x in jax.tree.leaves(memory))
    return {"tick_us": cost.microseconds[0], "state_bytes": held}


def _figures(case: LawCase, metrics: Any) -> dict[str, Any]:
    """What the table needs of each member."""
    costs = np.asarray(jax.vmap(lambda m: case.cost(m, m))(metrics), float)
    good = ~case.lost(metrics) & np.isfinite(costs)
    kept = {
        "good": good.tolist(),
        "cost": np.where(good, costs, 1e9).tolist(),
        "measures": {
            # A run that was lost early has nothing to take some means of.
            name: [
                x if np.isfinite(x) else None
                for x in np.asarray(of(metrics), float).tolist()
            ]
            for name, of in case.measures.items()
        },
    }
    if case.left is not None:
        kept["left"] = np.asarray(case.left[1](metrics)).tolist()
    return kept


if __name__ == "__main__":
    sys.exit(main())
