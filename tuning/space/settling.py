"""Gains of the fixed-time law whose surface settles in time, by construction."""

import math
from collections.abc import Collection
from operator import attrgetter
from typing import Any

import jax.numpy as jnp

from jaxglider.control.fxtppc import SURFACE_CONSTANT
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.bijections import Above, Bijection, Within
from tuning.space.coordinate import Coordinate
from tuning.space.edges import K2_GIVEN_K1, Edge

SURFACE = "surface-settles"

_SLACK = 1e-6
"""Share by which rounding may miss an edge that another number gives."""


def settling(
    loop: ClosedLoop, owner: str, time: float, names: Collection[str], k1_rule: bool
) -> tuple[dict[str, Coordinate], list[str]]:
    """Coordinates that keep the bound on s at most a time, and remarks.

    Of μ, k₁, k₂ the last that is tuned takes the edge, and those before leave it room.

    Args:
        loop: closed loop that the search starts from.
        owner: path of the gains of a channel.
        time: required settling time [s].
        names: paths of the tuned numbers.
        k1_rule: whether k₁ < ¾ k₂² is held too.
    """
    path = {name: f"{owner}.{name}" for name in ("mu", "k1", "k2")}
    tuned = [name for name in path if path[name] in names]
    need = SURFACE_CONSTANT / time
    rule = f"surface s settled after {time:g} s, 1.209 mu/(k1 + k2) <= {time:g}"
    if k1_rule:
        rule += f" and {K2_GIVEN_K1.rule}"

    def holds(mu: float, k1: float, k2: float) -> bool:
        inside = 0.0 < k1 < 0.75 * k2 * k2 if k1_rule else k1 > 0.0
        return inside and need * mu <= (k1 + k2) * (1.0 + _SLACK)

    if not tuned:
        mu, k1, k2 = (float(attrgetter(path[name])(loop)) for name in path)
        if need * mu <= k1 + k2:
            return {}, []
        return {}, [f"{SURFACE}: {owner} breaks its rule, {rule}: none is tuned."]
    if "k2" in tuned:

        def least(k1: Any, mu: Any) -> Any:
            edge = jnp.maximum(need * mu - k1, 0.0)
            return jnp.maximum(edge, K2_GIVEN_K1.at(k1)) if k1_rule else edge

        edge = Edge(least, rule, lambda k2, k1, mu: holds(mu, k1, k2))
        return {
            path["k2"]: Coordinate(path["k2"], Above(), edge, _of(path, "k1 mu"))
        }, []
    k2 = float(attrgetter(path["k2"])(loop))
    most = k2 + 0.75 * k2 * k2 if k1_rule else math.inf
    new: dict[str, Coordinate] = {}
    if "k1" in tuned:
        if need * 1.01 > 0.99 * most:
            words = f"{path['k2']} = {k2:g} is not tuned"
            return {}, [f"{SURFACE}: no {path['k1']} keeps its rule, {rule}: {words}."]
        edge = Edge(
            lambda mu: (jnp.maximum(need * mu - k2, 0.0), 0.75 * k2 * k2),
            rule,
            lambda k1, mu: holds(mu, k1, k2),
        )
        kind: Bijection = Within()
        if not k1_rule:
            edge = Edge(lambda mu: jnp.maximum(need * mu - k2, 0.0), rule, edge.holds)
            kind = Above()
        new[path["k1"]] = Coordinate(path["k1"], kind, edge, _of(path, "mu"))
    else:
        most = float(attrgetter(path["k1"])(loop)) + k2
    if "mu" in tuned and math.isfinite(most):
        top = most / need
        if top <= 1.0 + 1e-3:
            return {}, [f"{SURFACE}: no {path['mu']} keeps its rule, {rule}."]
        ends = (1.0, top if "k1" not in tuned else 0.999 * top)
        new[path["mu"]] = Coordinate(
            path["mu"],
            Within(),
            Edge(lambda *_: ends, rule, lambda mu, *_: 1.0 < mu <= top),
        )
    return new, []


def _of(path: dict[str, str], names: str) -> tuple[str, ...]:
    return tuple(path[name] for name in names.split())
