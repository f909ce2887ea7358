"""Errors over time: a few hundred members, thinned, and the worst of all."""

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.signals import CHANNELS, Channels
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import roll
from jaxglider.simulation.tick import Carry, TickInput
from jaxglider.uncertainty.members import Member, with_member
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.loop import draw

MEMBERS = 256
"""Number of members, from the first, whose errors make the ribbons."""
POINTS = 400
"""Approximate number of points of a line."""


@dataclasses.dataclass(frozen=True)
class Ribbons:
    """Errors of some members over time.

    Attributes:
        time: times of the points [s].
        errors: errors of each channel [m, rad], one row a member; NaN after a course
            has ended and where a run is not finite.
        edges: lower and upper edge of the funnel of each channel, of the worst member.
        worst: errors of the worst member.
    """

    time: np.ndarray
    errors: dict[str, np.ndarray]
    edges: dict[str, tuple[np.ndarray, np.ndarray]]
    worst: dict[str, np.ndarray]


def ribbons(campaign: Campaign, number: int, count: int, worst: int) -> Ribbons:
    """Run members again and keep their errors.

    Args:
        campaign: campaign they belong to.
        number: number of the set of gains.
        count: members of the campaign; its first ones are taken.
        worst: number of the worst one.
    """
    clock = campaign.uncertainty.scenario.clock
    step = max(clock.ticks // POINTS, 1)
    chosen = draw(campaign, 0, min(count, MEMBERS))[1]
    extra = draw(campaign, worst, 1)[1]
    members = jax.tree.map(
        lambda a, b: np.concatenate([np.asarray(a), np.asarray(b)]), chosen, extra
    )
    run = jax.jit(_curves, static_argnames="step")
    active, error, lower, upper = jax.device_get(
        run(campaign.loops[number], members, step=step)
    )
    time = np.asarray(clock.times())[:-1][::step]
    errors, edges, last = {}, {}, {}
    for name in CHANNELS:
        curves = np.where(active, getattr(error, name), np.nan)
        errors[name], last[name] = curves[:-1], curves[-1]
        edges[name] = (getattr(lower, name)[-1], getattr(upper, name)[-1])
    return Ribbons(time=time, errors=errors, edges=edges, worst=last)


def _curves(loop: ClosedLoop, members: Member, step: int) -> Any:
    """Errors of each member; JAX knows it again for loops of one kind."""
    return map_members(lambda member: _errors(loop, member, step), members)


def _errors(
    loop: ClosedLoop, member: Member, step: int
) -> tuple[Series, Channels[Series], Channels[Series], Channels[Series]]:
    def tick(
        carry: Carry, inputs: TickInput
    ) -> tuple[Carry, tuple[Series, Channels[Series], Channels[Series], Channels]]:
        after, record = loop_of_member.tick(carry, inputs)
        limits = record.limits
        lower = Channels(limits.depth.lower, limits.pitch.lower, limits.heading.lower)
        upper = Channels(limits.depth.upper, limits.pitch.upper, limits.heading.upper)
        return after, (record.active, record.error, lower, upper)

    loop_of_member, sea, noise = with_member(loop, member)
    outputs = roll(loop_of_member, sea, noise, tick)[1]
    thinned: tuple[Series, Channels[Series], Channels[Series], Channels[Series]]
    thinned = jax.tree.map(lambda x: x[::step], outputs)
    return thinned
