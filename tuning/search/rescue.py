"""A start for gains that cannot be descended from: the best that a short search finds.

Where many runs are lost, or turn where they should not, the gradients of these lead
nowhere, but a few hundred draws tell which way the gliders fly.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp

from jaxglider.core.containers import Series
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem
from tuning.search.evolution import cma_es

LOST_COST = 1.45
"""Objective from which a start is exchanged, in units of what a run like it costs on
the nominal case; the paper's gains, where all fly, come to 1.05."""
MOST_GENERATIONS, DRAWS_PER_GENERATION, SPREAD = 12, 64, 0.5
"""Largest number of generations of the search, draws of a generation, and spread of
the draws in the logarithm of a gain."""
PROMISING_COST = 1.25
"""Objective, in the same units, with which the search ends early: few runs, if any, are
lost."""


class SearchResult(NamedTuple):
    """Result of the search.

    Attributes:
        free: free numbers that are best.
        rollouts: number of rollouts spent.
        remark: account of what was done, in words.
    """

    free: Series
    rollouts: int
    remark: str


def is_lost(objectives: Series, cost_scale: float) -> bool:
    """Whether no start is worth a descent, by the objective of each."""
    return bool(jnp.min(objectives) >= LOST_COST * cost_scale)


def promising_gains(
    problem: TuningProblem,
    free: Series,
    objective: float,
    seed: int,
    tell: Callable[[str], None] = lambda text: None,
) -> SearchResult:
    """Gains to descend from instead of gains with which members go astray.

    CMA-ES on the training members, until few of them do.

    Args:
        problem: problem to solve.
        free: free numbers of the gains as given.
        objective: objective of these gains.
        seed: seed of the draws.
        tell: function that is told how far the search is.
    """
    run = problem.losses_on(problem.training)
    members = member_count(problem.training)
    budget = (1 + DRAWS_PER_GENERATION * MOST_GENERATIONS) * members
    generations = []
    search = cma_es(
        run,
        free,
        budget,
        DRAWS_PER_GENERATION,
        SPREAD,
        seed,
        members=members,
        known=objective,
    )
    for step in search:
        generations.append(step)
        tell(
            f"members go astray with the starting gains; searching: generation "
            f"{step.number}/{MOST_GENERATIONS}  objective {step.loss:.3g}"
        )
        if step.loss < PROMISING_COST * problem.cost_scale:
            break
    given, best = generations[0].loss, min(generations, key=lambda step: step.loss)
    spent = generations[-1].rollouts
    if not best.loss < given:
        return SearchResult(
            free,
            spent,
            f"members go astray with the starting gains (objective {given:.3g}), and "
            f"with {DRAWS_PER_GENERATION * MOST_GENERATIONS} others around them; "
            "descending all the same.",
        )
    return SearchResult(
        best.free,
        spent,
        f"members go astray with the starting gains (objective {given:.3g}): "
        f"descending from the best of a search of {best.number} "
        f"generation{'s' if best.number > 1 else ''} ({best.loss:.3g}).",
    )
