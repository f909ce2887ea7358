"""Sensitivity of the errors by derivatives through the rollout.

|∂f/∂x_j| σ_j, f the root mean square of an error and σ_j the standard deviation of what
is drawn: the change of f by a typical change of x_j, for small ones. The median over
members says what is usual; single derivatives of long runs can be huge and predict
nothing (see `rollout.evaluate`).
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.batching import map_members
from jaxglider.signals import CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import Member, with_member
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.loop import draw

MEMBERS = 64
_BLOCK = 32
"""Lanes to a block: fewer than in a rollout, a gradient keeps every tick's state."""


def gradient_scores(
    campaign: Campaign, number: int, count: int
) -> dict[str, np.ndarray]:
    """Median of |∂f/∂x_j| σ_j over members, for the error of each channel.

    Args:
        campaign: campaign whose first members are taken.
        number: number of the set of gains.
        count: members of the campaign.

    Returns:
        By name of the output; NaN where no member has a finite derivative.
    """
    members = draw(campaign, 0, min(count, MEMBERS))[1]
    slopes = jax.device_get(jax.jit(_all_slopes)(campaign.loops[number], members))
    scales = [q.standard_deviation() for q in campaign.uncertainty.quantities]
    columns = [
        scale * np.abs(np.asarray(slopes[q.path], np.float64))
        for scale, q in zip(scales, campaign.uncertainty.quantities, strict=True)
    ]
    sizes = np.stack(columns, axis=-1)
    scores = {}
    for place, channel in enumerate(CHANNELS):
        usable = np.all(np.isfinite(sizes[:, place]), axis=1)
        median = np.median(sizes[usable, place], axis=0) if usable.any() else None
        scores[f"{channel}.rms_error"] = (
            np.full(len(columns), np.nan) if median is None else median
        )
    return scores


def _all_slopes(loop: ClosedLoop, members: Member) -> dict[str, jax.Array]:
    """Derivatives of each member; JAX knows it again for loops of one kind."""
    slopes: dict[str, jax.Array] = map_members(
        lambda member: _slopes(loop, member), members, block=_BLOCK
    )
    return slopes


def _slopes(loop: ClosedLoop, member: Member) -> dict[str, jax.Array]:
    """Derivatives of the three errors by what was drawn."""

    def errors(values: dict[str, jax.Array]) -> jax.Array:
        metrics = evaluate(*with_member(loop, Member(values, member.key)))
        columns = [getattr(metrics.channels, c).rms_error for c in CHANNELS]
        return jnp.stack(columns)

    _, pull = jax.vjp(errors, member.values)
    # One backward pass after the other: side by side they would take three times
    # the memory.
    slopes: dict[str, jax.Array] = jax.lax.map(
        lambda seed: pull(seed)[0], jnp.eye(len(CHANNELS), dtype=_kind(loop))
    )
    return slopes


def _kind(loop: ClosedLoop) -> np.dtype:
    return np.dtype(loop.scenario.clock.dt.dtype)
