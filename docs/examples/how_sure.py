"""How sure are you.

One run says little. A sweep flies many gliders in many seas and says how likely each
kind of trouble is, with exact intervals: here for two laws of the paper, on the same
members.
"""

# %%
import argparse
from pathlib import Path

import jax

import jaxglider
from jaxglider import paper
from tuning import sweep

parser = argparse.ArgumentParser()
parser.add_argument("--duration", type=float, default=60.0)
parser.add_argument("--members", type=int, default=200)
parser.add_argument("--out", type=Path, default=Path("results/examples"))
options = parser.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

jaxglider.enable_fast_loops()
jax.config.update("jax_enable_x64", True)

# %%
# All loops fly the same scenario; each keeps its own controller and observer.

loops = {
    name: paper.make_loop(
        "switching", plant="rigid-body", controller=name, duration=options.duration
    )
    for name in ("fxtppc", "smc")
}

# %%
# Masses, inertias, coefficients and wave amplitudes are wrong by up to 20 %, and the
# phases of the waves are free.

report = sweep(loops, uncertainty=0.2, members=options.members, progress=False)
print(report)

# %%
# The rows are there too: as an `xarray` data set with `report.to_xarray()`, or as plain
# numbers.

for name, controller in report.summary.controllers.items():
    capsized = controller.probabilities["p_capsize"]
    low, high = capsized["interval"]
    print(f"{name}: rolls past 90 degrees in {low:.3f} to {high:.3f} of the gliders")
report.plot().savefig(options.out / "how_sure.png")
