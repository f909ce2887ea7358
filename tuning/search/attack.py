"""Severity of members by their places in the unit cube of what is uncertain.

What a search for the worst member looks at (`worst`): the box of the uncertainty as a
cube, the run of the member at a place in it, and the gradient of its severity.
"""

import copy
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Scalar, Series
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import Member, Uncertainty, with_member
from tuning.problem.members import SWEEP, keys_of, nominal_member

_EDGE = 1e-3
"""Distance from the ends of the cube for what has no end of its own."""
_MEMORY = 60.0
"""Memory of the gradient that ascends [s]; see `evaluate`."""
_STEP = 1e-5
"""Half a step of the difference by which coordinates become values."""


class Attack:
    """Severities of members by their places in the unit cube, compiled once."""

    BLOCK = 64

    def __init__(self, loop: ClosedLoop, box: Uncertainty, seed: int) -> None:
        """Prepare.

        Args:
            loop: closed loop to attack, in the scenario of the uncertainty.
            box: the uncertainty.
            seed: seed of what is left to chance within the runs, the same in all.
        """
        self.loop, self._box = loop, box
        self._key = keys_of(seed, SWEEP, jnp.arange(1))
        ends = [q.distribution.support() for q in box.quantities]
        self._open = np.array([not np.all(np.isfinite(pair)) for pair in ends], bool)
        self._run, self._slope = jax.jit(_severities), jax.jit(_slopes)

    def on(self, loop: ClosedLoop) -> "Attack":
        """The same attack on other gains, with the same compiled programs."""
        other = copy.copy(self)
        other.loop = loop
        return other

    def severities(self, places: np.ndarray) -> np.ndarray:
        """Severity of each row of places; in pieces of one size, compiled once."""
        found = []
        for start in range(0, len(places), self.BLOCK):
            part = places[start : start + self.BLOCK]
            filled = np.resize(part, (self.BLOCK, places.shape[1]))
            found.append(
                np.asarray(self._run(self.loop, self.members(filled)))[: len(part)]
            )
        return np.concatenate(found).astype(float)

    def slopes(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Severities and their gradients in the coordinates of the cube."""
        values, by_path = jax.device_get(self._slope(self.loop, self.members(places)))
        by_value = np.stack([by_path[q.path] for q in self._box.quantities], axis=1)
        slope = np.zeros_like(places)
        for column in range(places.shape[1]):
            low, high = places.copy(), places.copy()
            low[:, column] = np.maximum(low[:, column] - _STEP, 0.0)
            high[:, column] = np.minimum(high[:, column] + _STEP, 1.0)
            change = self.values(high) - self.values(low)
            width = (high - low)[:, column]
            slope[:, column] = (by_value * change).sum(axis=1) / width
        return np.asarray(values, float), slope

    def values(self, places: np.ndarray) -> np.ndarray:
        """Values of the uncertain quantities, one row a place."""
        inside = np.where(self._open, _EDGE + (1.0 - 2.0 * _EDGE) * places, places)
        return self._box.values(inside)

    def members(self, places: np.ndarray) -> Member:
        """The members at some places, as an ensemble."""
        keys = jnp.repeat(self._key, len(places), axis=0)
        if not self._box.quantities:
            return nominal_member(self.loop)
        return self._box.members(self.values(places), keys)


def _severities(loop: ClosedLoop, members: Member) -> Series:
    return map_members(lambda one: _severity_of(loop, one), members)


def _slopes(loop: ClosedLoop, members: Member) -> Any:
    """Severities and their gradients by the values of the quantities."""

    def slope_of(member: Member) -> Any:
        def of_values(values: Any) -> Scalar:
            changed = Member(values, member.key)
            return _severity_of(loop, changed, gradient_memory=_MEMORY)

        return jax.value_and_grad(of_values)(member.values)

    return map_members(slope_of, members)


def _severity_of(loop: ClosedLoop, member: Member, **options: Any) -> Scalar:
    return severity(evaluate(*with_member(loop, member), **options), loop)


def severity(metrics: Metrics, loop: ClosedLoop) -> Scalar:
    """The largest error over its specified edge, or the roll over its limit.

    Args:
        metrics: metrics of a run.
        loop: closed loop, whose specification has the limit.
    """
    parts = [of.funnel_peak for of in vars(metrics.channels).values()]
    specification = loop.scenario.specification
    if specification is not None and specification.largest_roll is not None:
        parts.append(metrics.max_roll / specification.largest_roll)
    worst_part = jnp.max(jnp.stack(parts))
    return jnp.where(metrics.finite, worst_part, jnp.inf)
