"""Tune a law of your own.

The law is a class in a file of its own, `proportional.py`. Its array fields are its
gains, and gradient descent through the rollout finds better ones on a handful of
gliders and seas.
"""

# %%
import argparse
from pathlib import Path

import jax
from proportional import Proportional

import jaxglider
from jaxglider import paper
from tuning import tune

parser = argparse.ArgumentParser()
parser.add_argument("--duration", type=float, default=60.0)
parser.add_argument("--members", type=int, default=4)
parser.add_argument("--steps", type=int, default=20)
parser.add_argument("--out", type=Path, default=Path("results/examples/tune_own_law"))
options = parser.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

jaxglider.enable_fast_loops()
jax.config.update("jax_enable_x64", True)

# %%
# The scenario has the paper's specification, which every law is judged by.

scenario = paper.make_scenario("switching", plant="printed", duration=options.duration)
law = Proportional(paper.design_model(scenario.plant))
loop = jaxglider.ClosedLoop(scenario, law, jaxglider.NoObserver())

# %%
# Members differ by up to 20 %. Some are descended on, others choose the best step, and
# the verdict is of members that the search has not seen. Ctrl-C keeps the best so far.

result = tune(
    loop,
    free=["controller.stiffness", "controller.friction"],
    members=options.members,
    validation=options.members,
    test=2 * options.members,
    steps=options.steps,
    check=False,
    progress=False,
)
print(result)

# %%
# Everything is there to look at: `result.gains`, `result.history`, `result.loop`. The
# gains file, the history and a report can be written.

result.plot().savefig(options.out / "search.png")
result.save(options.out)
print(f"{options.out} has the gains, the history and a report")
