"""A cost that wants the course finished, for `jaxglider tune --cost`.

Waypoints that are missed count most, then tracking, roll, and whatever chattering goes
beyond what a motor can follow. The number of waypoints has no slope: it is for searches
(`--method cma`); a descent sees the rest.
"""

import jax.numpy as jnp

WAYPOINTS = 5
TRACKED = {"depth": 0.02, "pitch": 0.04, "heading": 0.4}
WEIGHT = {"depth": 0.5, "pitch": 0.7, "heading": 1.5}
QUIET = {"depth": 4e-4, "pitch": 4e-4, "heading": 8e-3}
UPRIGHT = 1.2


def cost(metrics, start):
    """The cost of one run; that of the starting gains is not asked for."""
    del start
    total = 10.0 * (WAYPOINTS - metrics.waypoints_reached)
    total += 10.0 * jnp.maximum(metrics.max_roll - UPRIGHT, 0.0) ** 2
    for name, weight in WEIGHT.items():
        channel = getattr(metrics.channels, name)
        total += weight * channel.rms_error / TRACKED[name]
        total += 0.3 * jnp.maximum(channel.chattering / QUIET[name] - 1.0, 0.0)
    return total
