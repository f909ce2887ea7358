"""The worst member on purpose: a search of the uncertainty against random members."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Scalar
from jaxglider.files.results import metrics_dict
from jaxglider.files.writing import write_json
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import Member, Uncertainty, with_member
from tuning.problem.arguments import closed_loop, half_width, whole
from tuning.problem.case import FlightCase
from tuning.problem.members import SWEEP, keys_of, nominal_member
from tuning.problem.spec import DEFAULT_UNCERTAINTY, EnsembleSpec
from tuning.reporting.statistics import clopper_pearson, plain
from tuning.search.worst import STARTS, WorstCase, find_worst

_EDGE = 1e-3
"""Distance from the ends of the cube for what has no end of its own."""
_MEMORY = 60.0
"""Memory of the gradient that ascends [s]; see `evaluate`."""
_STEP = 1e-5
"""Half a step of the difference by which coordinates become values."""


@dataclasses.dataclass(frozen=True)
class WorstResult:
    """The worst member that a search found, beside the worst of random ones.

    Attributes:
        loop: closed loop that was flown, in the scenario of the uncertainty.
        case: outcome of the search in the unit cube.
        member: the member found, as an ensemble of one.
        values: value of each uncertain quantity, by its name.
        random_worst: highest severity of the random members; NaN without any.
        random_members: number of random members.
        missed: number of them that are less severe than the one found.
        metrics: metrics of the run of the member found, as plain numbers.
    """

    loop: ClosedLoop
    case: WorstCase
    member: Member
    values: dict[str, float]
    random_worst: float
    random_members: int
    missed: int
    metrics: dict[str, Any]

    def __str__(self) -> str:
        """The comparison in words, and what was drawn."""
        parts = ", ".join(f"{k} {v:.4g}" for k, v in self.case.best.items())
        lines = [
            f"worst found: severity {self.case.severity:.4g}, by {self.case.found_by}, "
            f"in {self.case.rollouts} rollouts ({parts})",
        ]
        if self.random_members:
            ends = clopper_pearson(self.missed, self.random_members)
            lines.append(
                f"worst of {self.random_members} random members: "
                f"{self.random_worst:.4g}; of these {self.missed} are less severe than "
                f"the one found (probability [{ends[0]:.4g}, {ends[1]:.4g}])"
            )
            if not self.case.severity >= self.random_worst:
                lines.append("the search did not find a member as bad as these.")
        lines += [f"{name:<28}{value:>12.5g}" for name, value in self.values.items()]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, as they stand in worst.json."""
        ends = None
        if self.random_members:
            ends = list(clopper_pearson(self.missed, self.random_members))
        return {
            "severity": plain(self.case.severity),
            "found_by": self.case.found_by,
            "rollouts": self.case.rollouts,
            "best": {name: plain(x) for name, x in self.case.best.items()},
            "place": self.case.place.tolist(),
            "values": self.values,
            "random": {
                "members": self.random_members,
                "worst": plain(self.random_worst),
                "less_severe": self.missed,
                "interval": ends,
            },
            "metrics": self.metrics,
        }

    def save(self, folder: str | Path, **more: Any) -> dict[str, Any]:
        """Write worst.json.

        Args:
            folder: folder to write to; made if it is not there.
            **more: further entries.

        Returns:
            Its content.

        Raises:
            OSError: it cannot be written.
        """
        content = {**self.to_dict(), **more}
        write_json(Path(folder) / "worst.json", content)
        return content


def worst(
    loop: ClosedLoop,
    *,
    uncertainty: Uncertainty | float = DEFAULT_UNCERTAINTY,
    budget: int = 200,
    random: int = 2000,
    seed: int = 0,
) -> WorstResult:
    """Search the uncertainty for the member that violates most.

    The severity of a run is the largest of: an error over the edge of the specified
    funnel, and the roll over the bank limit. Above 1 the specification is broken; a run
    that becomes non-finite is infinitely severe.

    Args:
        loop: closed loop to attack.
        uncertainty: quantities that differ between members; or one relative half width.
        budget: rollouts of the search, a gradient counted as five.
        random: number of random members to compare with; 0 for none.
        seed: seed of search and random members.

    Raises:
        ValueError: an argument cannot be used.
    """
    closed_loop("loop", loop)
    half_width(uncertainty, zero=False)
    whole("budget", budget, 4 * STARTS)
    whole("random", random, 0)
    whole("seed", seed, 0, 2**32)
    case = FlightCase.of_loop(loop, "own")
    loop = dataclasses.replace(loop, scenario=case.scenario)
    box = EnsembleSpec(uncertainty).on(loop)
    loop = dataclasses.replace(loop, scenario=box.scenario)
    attack = Attack(loop, box, seed)
    found = find_worst(
        attack.severities, attack.slopes, len(box.quantities), budget, seed
    )
    others = np.random.default_rng([seed, 1]).uniform(
        size=(random, len(box.quantities))
    )
    severities = attack.severities(others) if random else np.empty(0)
    return attack.result(found, severities)


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
        self._loop, self._box = loop, box
        self._key = keys_of(seed, SWEEP, jnp.arange(1))
        ends = [q.distribution.support() for q in box.quantities]
        self._open = np.array([not np.all(np.isfinite(pair)) for pair in ends], bool)

        def severity_of(member: Member, **options: Any) -> Scalar:
            return severity(evaluate(*with_member(loop, member), **options), loop)

        def slope_of(member: Member) -> Any:
            def of_values(values: Any) -> Scalar:
                return severity_of(Member(values, member.key), gradient_memory=_MEMORY)

            return jax.value_and_grad(of_values)(member.values)

        self._run = jax.jit(lambda members: map_members(severity_of, members))
        self._slope = jax.jit(lambda members: map_members(slope_of, members))

    def severities(self, places: np.ndarray) -> np.ndarray:
        """Severity of each row of places; in pieces of one size, compiled once."""
        found = []
        for start in range(0, len(places), self.BLOCK):
            part = places[start : start + self.BLOCK]
            filled = np.resize(part, (self.BLOCK, places.shape[1]))
            found.append(np.asarray(self._run(self._members(filled)))[: len(part)])
        return np.concatenate(found).astype(float)

    def slopes(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Severities and their gradients in the coordinates of the cube."""
        values, by_path = jax.device_get(self._slope(self._members(places)))
        by_value = np.stack([by_path[q.path] for q in self._box.quantities], axis=1)
        slope = np.zeros_like(places)
        for column in range(places.shape[1]):
            low, high = places.copy(), places.copy()
            low[:, column] = np.maximum(low[:, column] - _STEP, 0.0)
            high[:, column] = np.minimum(high[:, column] + _STEP, 1.0)
            change = self._values(high) - self._values(low)
            width = (high - low)[:, column]
            slope[:, column] = (by_value * change).sum(axis=1) / width
        return np.asarray(values, float), slope

    def result(self, found: WorstCase, severities: np.ndarray) -> WorstResult:
        """The member found beside random ones.

        Args:
            found: outcome of the search.
            severities: severities of random members.
        """
        row = self._values(found.place[None])
        member = self._members(found.place[None])
        run = jax.jit(lambda one: evaluate(*with_member(self._loop, one)))
        metrics = jax.device_get(run(jax.tree.map(lambda x: x[0], member)))
        course = self._loop.scenario.reference.can_finish
        return WorstResult(
            loop=self._loop,
            case=found,
            member=member,
            values=dict(zip(self._box.names(), map(float, row[0]), strict=True)),
            random_worst=float(severities.max()) if len(severities) else np.nan,
            random_members=len(severities),
            missed=int(np.sum(severities < found.severity)),
            metrics=metrics_dict(metrics, has_waypoints=course),
        )

    def _values(self, places: np.ndarray) -> np.ndarray:
        inside = np.where(self._open, _EDGE + (1.0 - 2.0 * _EDGE) * places, places)
        return self._box.values(inside)

    def _members(self, places: np.ndarray) -> Member:
        keys = jnp.repeat(self._key, len(places), axis=0)
        if not self._box.quantities:
            return nominal_member(self._loop)
        return self._box.members(self._values(places), keys)


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
