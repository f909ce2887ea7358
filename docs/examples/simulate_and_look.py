"""Simulate and look.

The paper's first case: the glider dives, and every 200 s it is given another gliding
angle and another heading. We fly the first of them and draw what happened.
"""

# %%
import argparse
from pathlib import Path

import jax

import jaxglider
from jaxglider import paper
from jaxglider.plotting import errors, tracking
from jaxglider.plotting.save import save
from jaxglider.plotting.style import PAGE, look, new_figure

parser = argparse.ArgumentParser()
parser.add_argument("--duration", type=float, default=200.0)
parser.add_argument("--out", type=Path, default=Path("results/examples"))
options = parser.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

jaxglider.enable_fast_loops()  # much faster on a CPU; before the first computation
jax.config.update("jax_enable_x64", True)

# %%
# A closed loop is a scenario (glider, actuators, sea, task, clock) with a controller
# and an observer. The sea is drawn from a key before the run, which is deterministic.

loop = paper.make_loop(
    "switching", plant="printed", controller="fxtppc", duration=options.duration
)
sea = loop.scenario.sea(jax.random.key(0))
run = jax.jit(jaxglider.simulate)(loop, sea)

# %%
# The metrics are the paper's. Angles are in radians everywhere but in figures.

for name, channel in vars(run.metrics.channels).items():
    outside = 100.0 * float(channel.time_outside_funnel)
    print(
        f"{name:8} L2[e] {float(channel.rms_error):.4f}, "
        f"outside its funnel {outside:.1f} % of the time"
    )
print(f"largest roll {float(run.metrics.max_roll):.2f} rad")

# %%
# Every figure is a function that draws on axes of yours.

with look():
    figure = new_figure(PAGE, 4.0)
    left, right = figure.subfigures(1, 2)
    tracking(left.subplots(3, 1, sharex=True), {"FxTPPC": run})
    errors(right.subplots(3, 1, sharex=True), {"FxTPPC": run})
    print(f"{save(figure, options.out / 'simulate_and_look.png')} written")
