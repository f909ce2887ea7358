"""A cost that wants heading above all, for `jaxglider tune --cost`; see heading.md.

It asks for what the tables of the paper would have to be beaten by (80, 30 and 30 % in
depth, pitch and heading) and for no more chattering than sliding mode shows, weighs
heading most, and lets the glider roll.
"""

import jax.numpy as jnp

WANTED = {"depth": 0.0199, "pitch": 0.0314, "heading": 0.1376}
QUIET = {"depth": 0.0014, "pitch": 0.0012, "heading": 0.05}
WEIGHT = {"depth": 0.5, "pitch": 1.0, "heading": 4.0}


def cost(metrics, start):
    """The cost of one run; that of the starting gains is not asked for."""
    del start
    total = 0.2 * jnp.maximum(metrics.max_roll - 1.5, 0.0) ** 2
    for name, wanted in WANTED.items():
        channel = getattr(metrics.channels, name)
        share = channel.rms_error / wanted
        total += WEIGHT[name] * share + 10.0 * channel.funnel_crowding
        total += 0.5 * jnp.maximum(channel.chattering / QUIET[name] - 1.0, 0.0)
        if name != "depth":
            total += 4.0 * jnp.maximum(share - 1.0, 0.0)
    return total
