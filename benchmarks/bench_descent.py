"""How far a descent comes from the starting gains, by what of a steep gradient counts.

`python benchmarks/bench_descent.py` descends with SMC on `rigid-body` and PID on
`seawing`, in `switching` on their actuators, for 40 steps of the default settings and
without the search that else comes first: with gradients that are heard up to 1.3 times
the cost of a run like the start, as `tune` has it, and up to 0.13 times, about norm
one. It prints the objective of the training and of the validation members at the start
and at its lowest. Run it in the folder above.
"""

import itertools
import sys

import jax
import numpy as np

from tuning.cli.session.jax_setup import start_jax
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import ProblemSpec
from tuning.search.descent import Descent
from tuning.search.settings import DescentSettings

CASES = (("smc", "rigid-body"), ("pid", "seawing"))
STEEPEST = (1.3, 0.13)
STEPS = 40


def main() -> int:
    start_jax(32, every_core=True)
    sys.stdout.write(
        "| law | plant | heard up to | training | validation |\n"
        "|---|---|---:|---|---|\n"
    )
    for (law, plant), steepest in itertools.product(CASES, STEEPEST):
        problem = TuningProblem.of(ProblemSpec.of_paper("switching", plant, law))
        losses = _descend(problem, steepest)
        cells = " | ".join(
            f"{values[0]:.2f} → {values.min():.2f}" for values in losses.T
        )
        sys.stdout.write(f"| {law} | {plant} | {steepest:g} | {cells} |\n")
        sys.stdout.flush()
    return 0


def _descend(problem: TuningProblem, steepest: float) -> np.ndarray:
    """Objectives of training and validation at the start and after each step."""
    descent = Descent(
        problem.loss,
        problem.training,
        problem.validation,
        DescentSettings(steps=STEPS, patience=STEPS, steepest=steepest),
        problem.spec.aggregate,
        surrogate_loss=problem.surrogate_loss,
        cost_scale=problem.cost_scale,
        devices=jax.devices(),
    )
    state = descent.start(problem.space.read(problem.loop))
    rows = [(float(state.current.loss[0]), float(state.chosen_loss[0]))]
    rows += [(step.loss, step.validation) for _, step in descent.run(state)]
    return np.asarray(rows)


if __name__ == "__main__":
    sys.exit(main())
