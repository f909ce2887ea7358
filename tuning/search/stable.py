"""The choice among the steps of a search: the best whose loop is stable.

Gains tuned on dives alone may be unstable on the climbs between them, and a motion that
grows slowly costs little on a run that ends before it is large.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Series
from jaxglider.simulation.checks.stability import glides_of, loop_modes
from tuning.problem.problem import TuningProblem
from tuning.search.settings import Step
from tuning.space.space import STABLE_LOOP

MOST_TRIED = 16
"""Steps whose stability is looked at, the best first."""


class Choice(NamedTuple):
    """Free numbers that were chosen, and a sentence where they are not the best.

    Attributes:
        free: free numbers.
        remark: account of the choice; empty where it is the best step.
    """

    free: Series
    remark: str


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
    glides = glides_of(problem.loop)
    if STABLE_LOOP not in problem.spec.constraints or not glides:
        return Choice(chosen, "")

    def is_stable(free: Series) -> bool:
        at_hand = jnp.asarray(jax.device_get(free))
        loop = problem.space.write(problem.loop, at_hand)
        return all(modes.stable for modes in loop_modes(loop, glides))

    if is_stable(chosen):
        return Choice(chosen, "")
    taken = [step for step in history if not step.refused]
    ranking = sorted(taken, key=lambda step: step.validation)[:MOST_TRIED]
    for step in ranking:
        if is_stable(step.free):
            return Choice(
                step.free,
                f"the gains are those of step {step.number}, the best with a stable "
                f"loop: {step.validation:.4g} on the validation members, where "
                f"{ranking[0].validation:.4g} is the best of all.",
            )
    return Choice(chosen, f"no step has a stable loop ({len(ranking)} looked at).")
