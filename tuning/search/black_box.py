"""Black-box search on the free numbers and members of a tuning task."""

from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Series
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.evolution import (
    Generation,
    cma_es,
    default_population,
    random_search,
)
from tuning.search.settings import DescentSettings, Step

SEARCHES: dict[str, Callable[..., Iterator[Generation]]] = {
    "cma": cma_es,
    "random": random_search,
}


def black_box(
    method: str,
    task: TuningProblem,
    start: Series,
    settings: DescentSettings,
    progress: Progress,
    population: int | None = None,
    *,
    spread: float,
) -> tuple[Series, list[Step], bool]:
    """Search with the budget that the descent of these settings would have.

    Args:
        method: `cma` or `random`.
        task: what to tune.
        start: free numbers to start from.
        settings: of the descent: what its steps cost, and the seed.
        progress: where to show progress.
        population: draws per generation; that of CMA-ES by default.
        spread: first standard deviation of the draws, in the logarithm of a gain.

    Returns:
        The free numbers that are best on the validation members, the history, and
        whether the search was interrupted.
    """
    members = member_count(task.training)
    budget = settings.steps * settings.gradient_cost(members, task.aggregate)
    population = population or default_population(int(start.shape[0]))
    search = SEARCHES[method](
        task.losses_on(task.training),
        start,
        budget,
        population,
        spread,
        settings.seed,
        members=members,
    )
    validate = task.losses_on(task.validation)
    history: list[Step] = []
    try:
        for found in search:
            free = jnp.asarray(found.free, start.dtype)
            validation = float(validate(free[None])[0])
            best = min((s.validation for s in history), default=np.inf)
            history.append(_step(found, free, validation, better=validation < best))
            progress.show(
                f"generation {found.number}  objective {found.loss:.4f}  "
                f"validation {validation:.4f}  best {min(best, validation):.4f}  "
                f"{found.rollouts}/{budget} rollouts"
            )
    except KeyboardInterrupt:
        if not history:
            raise
        progress.clear()
        note("interrupted; keeping the best gains so far.")
        return _best(history), history, True
    return _best(history), history, False


def _step(found: Generation, free: Series, validation: float, *, better: bool) -> Step:
    """A generation as a step of a descent."""
    return Step(
        found.number,
        found.loss,
        validation,
        free,
        False,
        better,
        found.learning_rate,
    )


def _best(history: list[Step]) -> Series:
    finite = [s for s in history if np.isfinite(s.validation)]
    return min(finite or history, key=lambda s: s.validation).free
