"""Adversarial rounds: the worst members for the gains reached are trained on too.

A mean over random members knows nothing of a corner of the box that none of them is in.
After each descent the uncertainty is searched for the members that violate most (see
`worst`); they join those that are descended on and those that the best step is chosen
by, and the descent goes on from there. This is the cutting-set method of Mutapcic and
Boyd (Optimization Methods and Software 24, 2009), with an objective in the place of
constraints and a search that promises no worst case. The held-out members stay random.

The found take places that random members keep until then, so that all rounds run the
same compiled programs.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Series
from jaxglider.uncertainty.members import Member
from tuning.problem.arguments import refuse
from tuning.problem.lanes import member_count
from tuning.problem.members import TRAINING, VALIDATION, sample_members
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import ProblemSpec
from tuning.reporting.statistics import plain
from tuning.search.attack import Attack
from tuning.search.settings import BlackBoxSettings
from tuning.search.worst import WorstCase, find_worst

FOUND = 4
"""Members that join in each round."""
BUDGET = 200
"""Rollouts of each search, a gradient counted as five; that of `worst`."""
_APART = 0.1
"""Least distance of found members: root mean square over the sides of the cube."""


@dataclasses.dataclass(frozen=True)
class AdversarialRound:
    """The worst members for the gains that a descent came to.

    Attributes:
        step: number of the step that the descent had come to.
        severity: severity of the worst found; infinite for a run that failed.
        found_by: part of the search that found it: `random`, `gradient` or `cma`.
        known: highest severity of the members found in earlier rounds, with these
            gains; None in the first.
        places: places of the worst in the unit cube, apart from each other, one row
            each, the worst first.
        members: values of their uncertain quantities, by name.
    """

    step: int
    severity: float
    found_by: str
    known: float | None
    places: tuple[tuple[float, ...], ...]
    members: tuple[dict[str, float], ...]

    @property
    def worst(self) -> float:
        """Highest severity known with these gains, found anew or earlier."""
        return self.severity if self.known is None else max(self.severity, self.known)


class Adversary:
    """Searches for the worst members of a problem, round by round.

    Attributes:
        rounds: number of rounds in which members join.
        problem: problem with places for the members to be found.
    """

    def __init__(self, problem: TuningProblem, rounds: int, seed: int = 0) -> None:
        """Prepare.

        Args:
            problem: problem to solve, with random members alone.
            rounds: number of rounds, positive.
            seed: seed of the searches.
        """
        box = problem.spec.ensemble.on(problem.loop)
        self.rounds, self._seed = rounds, seed
        self._box = box
        self._attack = Attack(problem.loop, box, problem.spec.ensemble.seed)
        self._random = member_count(problem.training), member_count(problem.validation)
        training, validation = (
            sample_members(
                box, problem.spec.ensemble.seed, kind, count + rounds * FOUND
            )
            for kind, count in zip((TRAINING, VALIDATION), self._random, strict=True)
        )
        self.problem = dataclasses.replace(
            problem, training=training, validation=validation
        )

    def search(
        self, free: Series, step: int, before: Sequence[AdversarialRound]
    ) -> AdversarialRound:
        """The worst members for some gains.

        Args:
            free: free numbers of the gains.
            step: number of the step that the descent has come to.
            before: earlier rounds.
        """
        # By way of the host: what lies on several devices would compile anew.
        free = jnp.asarray(jax.device_get(free))
        loop = self.problem.space.write(self.problem.loop, free)
        attack = self._attack.on(loop)
        found = find_worst(
            attack.severities,
            attack.slopes,
            len(self._box.quantities),
            BUDGET,
            self._seed + len(before),
        )
        known = _places(before)
        places = worst_apart(found, FOUND)
        return AdversarialRound(
            step=step,
            severity=found.severity,
            found_by=found.found_by,
            known=float(attack.severities(known).max()) if len(known) else None,
            places=_rows(places),
            members=tuple(
                dict(zip(self._box.names(), row, strict=True))
                for row in _rows(attack.values(places))
            ),
        )

    def joined(self, rounds: Sequence[AdversarialRound]) -> TuningProblem:
        """The problem with the members found in some rounds among its own.

        Args:
            rounds: rounds so far.
        """
        places = _places(rounds)
        if not len(places):
            return self.problem
        found = self._attack.members(places)
        return dataclasses.replace(
            self.problem,
            training=_with(self.problem.training, found, self._random[0]),
            validation=_with(self.problem.validation, found, self._random[1]),
        )


def read_rounds(tables: list[dict[str, Any]]) -> list[AdversarialRound]:
    """Rounds from the plain numbers of a checkpoint.

    Args:
        tables: content of each, as `dataclasses.asdict` and JSON make it.
    """
    return [
        AdversarialRound(
            **{
                **table,
                "places": tuple(tuple(row) for row in table["places"]),
                "members": tuple(table["members"]),
            }
        )
        for table in tables
    ]


def rounds_dict(searches: Sequence[AdversarialRound]) -> dict[str, Any] | None:
    """Plain numbers of a tuning's searches, as they stand in tune.json; None for none.

    Args:
        searches: rounds in which members joined, and behind them the search on the
            tuned gains, whose members did not.
    """
    if not searches:
        return None
    return {
        "joined": sum(len(one.places) for one in searches[:-1]),
        "rollouts_of_a_search": BUDGET,
        "searches": [
            {
                "step": one.step,
                "severity": plain(one.severity),
                "found_by": one.found_by,
                "known": None if one.known is None else plain(one.known),
                "worst": plain(one.worst),
                "members": list(one.members),
            }
            for one in searches
        ],
    }


def refuse_rounds(
    spec: ProblemSpec, method: BlackBoxSettings | None, rounds: int
) -> None:
    """Refuse rounds where there is nothing to search, or no descent to go on with.

    Args:
        spec: problem to solve.
        method: search without gradients that is asked for, or None.
        rounds: number of rounds that is asked for.

    Raises:
        ValueError: rounds cannot be made.
    """
    ensemble = spec.ensemble
    if method is not None:
        rule = f"0 with {method.method}: rounds go on with a descent"
        raise refuse("adversarial", rule, rounds)
    if ensemble.training == 1 or not ensemble.on(spec.loop).quantities:
        rule = "0 where nothing is uncertain (members=1, or uncertainty=0)"
        raise refuse("adversarial", rule, rounds)


def worst_apart(found: WorstCase, count: int) -> np.ndarray:
    """Places of the worst members of a search, each apart from those worse than it.

    Args:
        found: outcome of the search.
        count: number of places; fewer where it has no more.
    """
    chosen: list[np.ndarray] = []
    for row in np.argsort(-found.severities, kind="stable"):
        place = found.places[row]
        far = [np.sqrt(np.mean((place - one) ** 2)) >= _APART for one in chosen]
        if all(far):
            chosen.append(place)
        if len(chosen) == count:
            break
    return np.stack(chosen)


def _rows(table: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in table)


def _places(rounds: Sequence[AdversarialRound]) -> np.ndarray:
    rows = [place for one in rounds for place in one.places]
    return np.array(rows) if rows else np.empty((0, 0))


def _with(members: Member, found: Member, first: int) -> Member:
    """Members with those from a number on replaced by others."""

    def place(old: Any, new: Any) -> Any:
        both = np.array(old)
        both[first : first + len(new)] = new
        return jnp.asarray(both)

    return jax.tree.map(place, members, found)
