"""Differentiate a rollout.

How does the pitch error of a whole run change with every gain of the controller? One
reverse pass answers for all gains at once; a finite difference checks one of them.
"""

# %%
import argparse

import equinox as eqx
import jax

import jaxglider
from jaxglider import paper

parser = argparse.ArgumentParser()
parser.add_argument("--duration", type=float, default=40.0)
options = parser.parse_args()

jaxglider.enable_fast_loops()
jax.config.update("jax_enable_x64", True)

loop = paper.make_loop(
    "switching", plant="rigid-body", controller="fxtppc", duration=options.duration
)
sea = loop.scenario.sea(jax.random.key(0))

# %%
# A controller's array fields are its gains, so the derivative with respect to the gains
# is a controller of the same shape that holds derivatives.


def pitch_error(gains):
    changed = eqx.tree_at(lambda at: at.controller.gains, loop, gains)
    return jaxglider.evaluate(changed, sea).channels.pitch.rms_error


gains = loop.controller.gains
value, slopes = jax.jit(jax.value_and_grad(pitch_error))(gains)
print(f"pitch L2[e] = {float(value):.5f} rad")
for channel, slope in vars(slopes).items():
    print(channel, {name: f"{float(x):+.3e}" for name, x in vars(slope).items()})

# %%
# A central difference for one gain. Rollouts are smooth: signed powers are rounded off
# at zero, and the error transformation goes on as a straight line outside the funnel.

run = jax.jit(pitch_error)
step = 1e-4 * float(gains.pitch.k2)


def at(k2):
    return float(run(eqx.tree_at(lambda g: g.pitch.k2, gains, k2)))


k2 = float(gains.pitch.k2)
difference = (at(k2 + step) - at(k2 - step)) / (2.0 * step)
slope = float(slopes.pitch.k2)
print(f"d/dk2: reverse mode {slope:+.8e}, central difference {difference:+.8e}")
