"""A descent from its start to its end, with what goes on beside it."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax.numpy as jnp

from jaxglider.core.containers import Series
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.adversarial import AdversarialRound, Adversary, read_rounds
from tuning.search.beginning import begin
from tuning.search.checkpoint import Checkpoint
from tuning.search.descent import Descent
from tuning.search.settings import DescentSettings, State, Step
from tuning.search.stable import stable_choice
from tuning.space.space import STABLE_LOOP

_BLIND = (
    "the descent ended early: no gradient is finite at these gains, where the "
    "loop amplifies every difference. Try --method cma, other --gains, a "
    "shorter --gradient-memory or --precision 64."
)
_ALL_FAIL = "the rounds ended early: with the members found all that count fail."


@dataclasses.dataclass(frozen=True)
class SearchOutcome:
    """Result of a search.

    Attributes:
        free: free numbers that are best on the validation members.
        history: steps of the search, the start first.
        remarks: sentences on the start and the gradient, for a report.
        interrupted: whether the search was stopped before its end.
        rounds: adversarial rounds in which members joined.
    """

    free: Series
    history: list[Step]
    remarks: tuple[str, ...] = ()
    interrupted: bool = False
    rounds: tuple[AdversarialRound, ...] = ()

    @property
    def candidates(self) -> list[Step]:
        """Steps since the last round: all that the same validation members judged."""
        return since_round(self.history, self.rounds)


def descend(
    problem: TuningProblem,
    settings: DescentSettings,
    progress: Progress,
    *,
    adversary: Adversary | None = None,
    checkpoint: Checkpoint | None = None,
    resume: bool = False,
    check: bool = True,
    meanwhile: Callable[[], Any] = lambda: None,
) -> SearchOutcome:
    """Descend to the end or to an interruption; what was reached is kept.

    Args:
        problem: problem to solve; that of the adversary where there is one.
        settings: settings of the descent, of each round anew.
        progress: line that shows how far it is.
        adversary: adversary that finds members which join after a descent, or None.
        checkpoint: file that every step is kept in, or None.
        resume: whether to go on from the checkpoint.
        check: whether to check the gradient against differences at the start.
        meanwhile: function called once the descent has compiled, before a search for a
            better start and the first step.

    Raises:
        FloatingPointError: the objective is not finite at any start.
        CannotStart: no gains that a search tried keep the gliders.
        ValueError: the checkpoint cannot be gone on with.
    """
    descent, state, remarks = begin(
        problem, settings, progress, resume, check, meanwhile
    )
    for remark in remarks:
        note(remark)
    history = [_first_step(state, settings, 0)]
    rounds: list[AdversarialRound] = []
    if resume and checkpoint is not None:
        state, history = checkpoint.load(state)
        rounds = read_rounds(checkpoint.about().get("rounds", []))
        descent = _on_found(descent, adversary, rounds)
        note(f"resumed after step {history[-1].number}.")
    interrupted = False
    try:
        while True:
            for reached in _steps(descent, state, history, settings, progress):
                state = reached
                if checkpoint is not None:
                    checkpoint.save(state, history, rounds)
            if adversary is None or len(rounds) == adversary.rounds:
                break
            progress.show("searching for the worst members ...")
            found, joined, first = _round(
                problem, adversary, descent, state, history, rounds
            )
            if not joined.can_run(first):
                remarks = (*remarks, _ALL_FAIL)
                break
            descent, state = joined, first
            history.append(_first_step(state, settings, history[-1].number))
            rounds.append(found)
            if checkpoint is not None:
                checkpoint.save(state, history, rounds)
    except KeyboardInterrupt:
        interrupted = True
        progress.clear()
        how = " (go on with --resume)" if checkpoint is not None else ""
        note(f"interrupted; keeping the best gains so far{how}.")
    if not interrupted and descent.is_blind(state):
        progress.clear()
        note(_BLIND)
    return SearchOutcome(_chosen(state), history, remarks, interrupted, tuple(rounds))


def _round(
    problem: TuningProblem,
    adversary: Adversary,
    descent: Descent,
    state: State,
    history: list[Step],
    rounds: list[AdversarialRound],
) -> tuple[AdversarialRound, Descent, State]:
    """The worst members for the gains reached, and the descent with them, begun."""
    free, steps = _chosen(state), since_round(history, rounds)
    if STABLE_LOOP in problem.spec.constraints:
        free = stable_choice(problem, free, steps).free
    found = adversary.search(free, history[-1].number, rounds)
    joined = _on_found(descent, adversary, [*rounds, found])
    return found, joined, joined.start(free)


def since_round(history: list[Step], rounds: Sequence[AdversarialRound]) -> list[Step]:
    """The steps since the last round, its start first; all where there was none.

    Args:
        history: steps of a descent.
        rounds: rounds of it so far.
    """
    if not rounds:
        return history
    # A round begins with a row of the same number as the step before it.
    begun = [at for at, x in enumerate(history) if x.number == rounds[-1].step]
    return history[begun[-1] :]


def _on_found(
    descent: Descent, adversary: Adversary | None, rounds: Sequence[AdversarialRound]
) -> Descent:
    """The descent on the members found so far too."""
    if adversary is None:
        return descent
    problem = adversary.joined(rounds)
    return descent.on(problem.training, problem.validation)


def _chosen(state: State) -> Series:
    return state.chosen_free[state.leader()]


def _first_step(state: State, settings: DescentSettings, number: int) -> Step:
    """The start of a descent as the step of a number."""
    leader = state.leader()
    return Step(
        number=number,
        loss=float(state.current.loss[leader]),
        validation=float(state.chosen_loss[leader]),
        free=state.current.free[leader],
        refused=False,
        best=True,
        learning_rate=settings.learning_rate,
    )


def _steps(
    descent: Descent,
    state: State,
    history: list[Step],
    settings: DescentSettings,
    progress: Progress,
) -> Iterator[State]:
    """The states of a descent, each step appended to the history and shown."""
    begun, first = time.monotonic(), int(state.number)
    before = history[-1].number - first
    for reached, step in descent.run(state):
        history.append(dataclasses.replace(step, number=before + step.number))
        yield reached
        pace = (time.monotonic() - begun) / max(step.number - first, 1)
        text = _line(step, reached, settings, pace)
        progress.show(text, step.number, settings.steps)


def _line(step: Step, state: State, settings: DescentSettings, pace: float) -> str:
    """Progress of the descent, in one line."""
    return (
        f"step {step.number}/{settings.steps}  "
        f"objective {step.loss:.4f}  validation {step.validation:.4f}  "
        f"best {float(jnp.min(state.chosen_loss)):.4f}  "
        f"{'refused  ' if step.refused else ''}"
        f"{pace * (settings.steps - step.number):.0f} s left"
    )
