"""The baseline that an objective is relative to: the nominal run before tuning.

A term over nothing tells nothing. A straight dive keeps its heading to the last bit,
and members that start a few degrees off it would cost thousands of millions. Where the
nominal run comes to less than `NEGLIGIBLE` of an absolute scale, that scale stands in
its place:

| measure | absolute scale |
|---|---|
| errors | the nearer edge of the settled funnel |
| L2[U] | the limit of the actuator |
| L2[ΔU] | a hundredth of that, per tick |
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.control import AbstractController
from jaxglider.core.containers import Scalar
from jaxglider.core.kept.programs import kept
from jaxglider.files.codec import FAMILIES
from jaxglider.signals import Channels, map_fields
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import ChannelMetrics, Metrics
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import with_member
from tuning.problem.gain_sets import PAPER
from tuning.problem.members import nominal_member
from tuning.problem.spec import ProblemSpec

NEGLIGIBLE = 0.01
"""Share of an absolute scale below which a nominal run is no measure of others; the
paper's gains and the tuned ones come to more in every channel of both cases."""

_NO_FUNNEL, _LATE = 0.2, 1e9
"""Edge where there is no funnel [m, rad]; and a time at which every funnel has settled
[s]."""


def nominal_metrics(loop: ClosedLoop) -> Metrics:
    """The nominal run of a closed loop.

    Args:
        loop: closed loop of the problem, in the scenario of the ensemble.
    """
    member = jax.tree.map(lambda x: x[0], nominal_member(loop))
    found: Metrics = _evaluate(*with_member(loop, member))
    return found


_evaluate = kept(evaluate)


def baseline_metrics(
    spec: ProblemSpec, loop: ClosedLoop, start: Metrics | None = None
) -> Metrics:
    """The nominal run with the starting gains, or with the paper's if that fails.

    Args:
        spec: description of the problem.
        loop: closed loop of the problem, in the scenario of the ensemble.
        start: nominal run with the starting gains, where it is known.

    Raises:
        ValueError: it is over before its first tick.
    """
    baseline = nominal_metrics(loop) if start is None else start
    own = spec.controller not in FAMILIES[AbstractController]
    if not bool(baseline.finite) and not own:
        (gains,) = spec.case.resolve([PAPER], [spec.controller])
        paper = dataclasses.replace(spec.case.loop(gains)[1], scenario=loop.scenario)
        baseline = nominal_metrics(paper)
    if not float(baseline.end_time) > 0.0:
        raise ValueError(
            "nothing to tune: the last waypoint is reached where the glider starts. "
            "Move the waypoint or the start, or make its radius smaller."
        )
    return comparable(baseline, loop)


def comparable(baseline: Metrics, loop: ClosedLoop) -> Metrics:
    """A nominal run with absolute scales where it comes to next to nothing."""

    def channel(of: ChannelMetrics, edge: Scalar, limit: Scalar) -> ChannelMetrics:
        scales = {
            **dict.fromkeys(("max_error", "max_error_settled", "rms_error"), edge),
            "rms_effort": limit,
            "chattering": 0.01 * limit,
            "travel": limit,
        }
        values = {
            name: jnp.where(getattr(of, name) < NEGLIGIBLE * scale, scale, value)
            for name, scale in scales.items()
            for value in (getattr(of, name),)
        }
        return dataclasses.replace(of, **values)

    a = loop.scenario.actuators
    limits = Channels(
        *(one.limit for one in (a.buoyancy_mass, a.mass_position, a.mass_angle))
    )
    channels = map_fields(channel, baseline.channels, _edges(loop), limits)
    return dataclasses.replace(baseline, channels=channels)


def _edges(loop: ClosedLoop) -> Channels[Any]:
    """The nearer edge of each channel's funnel once it has settled."""
    judge: Any = loop.scenario.specification or loop.controller
    late = jnp.full_like(loop.scenario.clock.dt, _LATE)

    def nearer(limits: Any) -> Scalar:
        edge = jnp.minimum(-limits.lower, limits.upper)
        return jnp.where(jnp.isfinite(edge), edge, _NO_FUNNEL)

    return map_fields(nearer, judge.limits(judge.bounds(late)))
