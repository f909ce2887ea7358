"""Put it on board.

A law of one's own as C99. The C is written from the trace of the very function that
was simulated and tuned, with guidance, observer and limits of the actuators; `make` in
the folder compiles it and compares it with JAX, tick by tick.
"""

# %%
import argparse
from pathlib import Path

import jax
from proportional import Proportional

import jaxglider
from jaxglider import paper
from jaxglider.export import export_c

parser = argparse.ArgumentParser()
parser.add_argument("--duration", type=float, default=60.0)
parser.add_argument("--out", type=Path, default=Path("results/examples/on_board"))
options = parser.parse_args()

jaxglider.enable_fast_loops()
jax.config.update("jax_enable_x64", True)  # the export is compared in double precision

# %%
# `proportional.py` beside this file has the law: a spring and a damper on each channel.

scenario = paper.make_scenario("switching", plant="printed", duration=options.duration)
model = paper.design_model(scenario.plant)
loop = jaxglider.ClosedLoop(scenario, Proportional(model), jaxglider.NoObserver())

# %%
bundle = export_c(loop, "A spring and a damper on each channel")
bundle.write(options.out)
for name in sorted(bundle.files):
    print(f"{name:24} {len(bundle.files[name]):8} characters")
single, double = bundle.cost.state_bytes
print(f"state: {single} bytes in single precision, {double} in double")
print(f"now: make -C {options.out}")
