"""Black-box search on the free numbers and members of a tuning task."""

from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Series
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.descend import SearchOutcome
from tuning.search.evolution import (
    Generation,
    cma_es,
    default_population,
    random_search,
)
from tuning.search.rescue import (
    SHOWN,
    SearchResult,
    all_lost,
    cannot_start,
    refuse_lost_task,
)
from tuning.search.settings import BlackBoxSettings, DescentSettings, Step

SEARCHES: dict[str, Callable[..., Iterator[Generation]]] = {
    "cma": cma_es,
    "random": random_search,
}


def search_black_box(
    problem: TuningProblem,
    settings: BlackBoxSettings,
    budget: DescentSettings,
    progress: Progress,
) -> SearchOutcome:
    """Search with the budget that a descent would have.

    Args:
        problem: problem to solve.
        settings: settings of the search.
        budget: settings of the descent whose cost is the budget, and the seed.
        progress: line that shows how far it is.

    Raises:
        KeyboardInterrupt: it was interrupted before the first generation.
        CannotStart: every glider is lost with all gains, or by the task itself.
    """
    refuse_lost_task(problem, progress)
    progress.show("compiling the search ...")
    start = problem.space.read(problem.loop)
    members = member_count(problem.training)
    rollouts = budget.steps * budget.gradient_cost(members, problem.spec.aggregate)
    search = SEARCHES[settings.method](
        problem.losses_on(problem.training),
        start,
        rollouts,
        settings.population or default_population(int(start.shape[0])),
        settings.spread,
        budget.seed,
        members=members,
    )
    validate = problem.losses_on(problem.validation)
    history: list[Step] = []
    interrupted = False
    try:
        for generation in search:
            free = jnp.asarray(generation.free, start.dtype)
            validation = float(validate(free[None])[0])
            best = min((s.validation for s in history), default=np.inf)
            history.append(
                _step(generation, free, validation, better=validation < best)
            )
            progress.show(
                f"generation {generation.number}  objective {generation.loss:.4f}  "
                f"validation {validation:.4f}  best {min(best, validation):.4f}  "
                f"{generation.rollouts}/{rollouts} rollouts",
                generation.rollouts,
                rollouts,
            )
    except KeyboardInterrupt:
        if not history:
            raise
        interrupted = True
        progress.clear()
        note("interrupted; keeping the best gains so far.")
    if not interrupted and all_lost(problem, [step.loss for step in history]):
        leaders = sorted(history[1:], key=lambda step: step.loss)[:SHOWN]
        remark = f"members go astray with all of {len(history)} generations"
        progress.show("looking why the gliders are lost ...")
        error = cannot_start(problem, SearchResult(start, 0, remark, tuple(leaders)))
        progress.clear()
        raise error
    return SearchOutcome(_best(history), history, interrupted=interrupted)


def _step(
    generation: Generation, free: Series, validation: float, *, better: bool
) -> Step:
    """A generation as a step of a descent."""
    return Step(
        number=generation.number,
        loss=generation.loss,
        validation=validation,
        free=free,
        refused=False,
        best=better,
        learning_rate=generation.learning_rate,
    )


def _best(history: list[Step]) -> Series:
    finite = [s for s in history if np.isfinite(s.validation)]
    return min(finite or history, key=lambda s: s.validation).free
