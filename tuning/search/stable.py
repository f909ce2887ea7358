"""The choice among the steps of a search: the best whose loop is stable.

Gains tuned on dives alone may be unstable on the climbs between them, and a motion that
grows slowly costs little on a run that ends before it is large.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Series
from jaxglider.simulation.checks.stability import (
    LoopModes,
    glides_of,
    loop_modes,
    statement,
)
from tuning.problem.problem import TuningProblem
from tuning.search.settings import Step
from tuning.space.space import STABLE_LOOP

MOST_TRIED = 16
"""Steps whose stability is looked at, the best first."""


class Choice(NamedTuple):
    """Free numbers that were chosen, and what there is to say of them.

    Attributes:
        free: free numbers.
        remarks: sentences on the choice, where it is not the best step, and on the
            stability of the loop; empty where the task has no straight glides.
    """

    free: Series
    remarks: tuple[str, ...]


def stable_choice(
    problem: TuningProblem, chosen: Series, history: list[Step]
) -> Choice:
    """The step that is best on the validation members of those with a stable loop.

    Stable on the straight glides of the task, each as a dive and as a climb. The best
    of all is kept where the task has no such glides, the constraint `stable-loop` is
    not held, or none of the best `MOST_TRIED` steps is stable.

    Args:
        problem: problem that was searched.
        chosen: free numbers that are best, stable or not.
        history: steps of the search.
    """
    if not glides_of(problem.loop):
        return Choice(chosen, ())
    best = modes_with(problem, chosen)
    said = (statement(best),)
    if not _asked(problem) or _is_stable(best):
        return Choice(chosen, said)
    taken = [step for step in history if not step.refused]
    ranking = sorted(taken, key=lambda step: step.validation)[:MOST_TRIED]
    for step in ranking:
        if np.array_equal(step.free, chosen):
            continue
        modes = modes_with(problem, step.free)
        if _is_stable(modes):
            remark = (
                f"the gains are those of step {step.number}, the best with a stable "
                f"loop: {step.validation:.4g} on the validation members, where "
                f"{ranking[0].validation:.4g} is the best of all."
            )
            return Choice(step.free, (remark, statement(modes)))
    none = f"no step has a stable loop ({len(ranking)} looked at)."
    return Choice(chosen, (none, *said))


def loop_is_stable(problem: TuningProblem, free: Series) -> bool:
    """Whether the loop is stable where it is asked to be; true where it is not.

    Args:
        problem: problem that is searched.
        free: free numbers.
    """
    return not _asked(problem) or _is_stable(modes_with(problem, free))


def modes_with(problem: TuningProblem, free: Series) -> list[LoopModes]:
    """The natural motions of the loop on the straight glides of the task.

    Args:
        problem: problem that is searched.
        free: free numbers.
    """
    # By way of the host: what lies on several devices would compile anew.
    at_hand = jnp.asarray(jax.device_get(free))
    loop = problem.space.write(problem.loop, at_hand)
    return loop_modes(loop, glides_of(problem.loop))


def _asked(problem: TuningProblem) -> bool:
    return STABLE_LOOP in problem.spec.constraints


def _is_stable(modes: list[LoopModes]) -> bool:
    return all(one.stable for one in modes)
