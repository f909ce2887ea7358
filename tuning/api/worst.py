"""The worst member on purpose: a search of the uncertainty against random members."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxglider.files.results import metrics_dict
from jaxglider.files.writing import write_json
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import Member, Uncertainty, with_member
from tuning.problem.arguments import closed_loop, half_width, whole
from tuning.problem.case import FlightCase
from tuning.problem.spec import DEFAULT_UNCERTAINTY, EnsembleSpec
from tuning.reporting.statistics import clopper_pearson, plain
from tuning.search.attack import Attack
from tuning.search.worst import STARTS, WorstCase, find_worst

_SAME = 0.01
"""Share by which severities that count as the same may differ."""


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

    @property
    def as_bad(self) -> bool:
        """Whether the member found is as severe as the worst random one, to 1 %.

        Errors of angles end at half a turn: of members that all turn round, one is as
        bad as another.
        """
        return not self.case.severity < (1.0 - _SAME) * self.random_worst

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
            if not self.as_bad:
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
                "found_as_bad": self.as_bad if self.random_members else None,
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
    return _beside_random(attack, box, found, severities)


def _beside_random(
    attack: Attack, box: Uncertainty, found: WorstCase, severities: np.ndarray
) -> WorstResult:
    """The member found beside random ones.

    Args:
        attack: attack that found it.
        box: the uncertainty.
        found: outcome of the search.
        severities: severities of random members.
    """
    loop, place = attack.loop, found.place[None]
    member = attack.members(place)
    run = jax.jit(lambda one: evaluate(*with_member(loop, one)))
    metrics = jax.device_get(run(jax.tree.map(lambda x: x[0], member)))
    course = loop.scenario.reference.can_finish
    row = attack.values(place)[0]
    return WorstResult(
        loop=loop,
        case=found,
        member=member,
        values=dict(zip(box.names(), map(float, row), strict=True)),
        random_worst=float(severities.max()) if len(severities) else np.nan,
        random_members=len(severities),
        missed=int(np.sum(severities < found.severity)),
        metrics=metrics_dict(metrics, has_waypoints=course),
    )
