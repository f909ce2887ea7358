"""Rollouts: the scan of a closed loop over all control ticks."""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.core.containers import Scalar, Series
from jaxglider.core.numerics import scale_gradient
from jaxglider.core.traced_once import traced_once
from jaxglider.navigation.errors import close_navigation
from jaxglider.navigation.sensing.readings import Sampled
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.flight import close_flight
from jaxglider.simulation.metrics import Metrics, finish
from jaxglider.simulation.scenario import Scenario, SensorErrors
from jaxglider.simulation.tick import Carry, TickInput, TickPlan, TickRecord


class Trajectory(eqx.Module):
    """A rollout tick by tick.

    Attributes:
        ticks: records with a leading time axis.
        metrics: measures of performance of the whole run.
    """

    ticks: TickRecord
    metrics: Metrics


Kept = TypeVar("Kept")


def roll(
    loop: ClosedLoop,
    sea: BodyAxes[Series],
    noise: SensorErrors | None,
    tick: Callable[[Carry, TickInput], tuple[Carry, Kept]],
    *,
    checkpoint_every: int = 1,
    keep_every: int = 1,
) -> tuple[Metrics, Kept]:
    """The scan over all ticks; `simulate` and `evaluate` differ in what they keep.

    The end of a tick is the start of the next: it is handed on, not read twice.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance.
        noise: the realised errors of the sensors, or None.
        tick: `loop.tick`, or a function around it that chooses what is kept.
        checkpoint_every: ticks from one kept state to the next; see `evaluate`.
        keep_every: ticks from one kept output to the next; see `simulate`.

    Returns:
        The metrics, and what each tick has kept, stacked.

    Raises:
        ValueError: a number of ticks does not divide that of the run, or samples of
            instruments are missing.
    """
    _check(
        loop.scenario, noise, checkpoint_every=checkpoint_every, keep_every=keep_every
    )
    first, ends = (
        jax.tree.map(lambda path, part=part: path[part], (sea, noise))
        for part in (0, slice(1, None))
    )

    def step(carry: Any, end: TickPlan) -> Any:
        inner, (force, errors) = carry
        after, outputs = tick(inner, TickInput(end, force, errors))
        return (after, (end.force_end, end.noise_end)), outputs

    def through(carry: Any, part: Any) -> Any:
        return lax.scan(step, carry, loop.plan(*part))

    known = (loop.scenario.clock.times()[:-1], *ends)
    (last, _), outputs = _in_parts(
        through, (loop.init(), first), known, checkpoint_every, keep_every
    )
    return closed(loop.scenario, last), outputs


def _in_parts(
    through: Callable[[Any, Any], Any],
    start: Any,
    known: Any,
    checkpoint_every: int,
    keep_every: int,
) -> Any:
    """The scan `through` all ticks, part by part where not every tick is kept."""
    if keep_every == checkpoint_every == 1:
        return through(start, known)

    def first_of(carry: Any, part: Any) -> Any:
        after, all_of_it = through(carry, part)
        return after, jax.tree.map(lambda x: x[0], all_of_it)

    length = keep_every if keep_every > 1 else checkpoint_every
    parts = jax.tree.map(lambda x: x.reshape(-1, length, *x.shape[1:]), known)
    if keep_every > 1:
        return lax.scan(first_of, start, parts)
    again = jax.checkpoint(through, prevent_cse=False)
    last, outputs = lax.scan(again, start, parts)
    return last, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), outputs)


def _check(scenario: Scenario, noise: SensorErrors | None, **every: int) -> None:
    """Refuse parts that do not fill the run, and instruments without samples."""
    ticks = scenario.clock.ticks
    for name, number in every.items():
        if number < 1 or ticks % number:
            raise ValueError(
                f"{name} must divide the {ticks} ticks; received {number}."
            )
    if scenario.instruments is not None and not isinstance(noise, Sampled):
        raise ValueError(
            "a scenario with instruments needs their samples: pass "
            "loop.scenario.noise(key) as the third argument."
        )


def closed(scenario: Scenario, last: Carry) -> Metrics:
    """Metrics of a run from what it ends with: of errors, flight and navigation.

    Args:
        scenario: scenario that was flown.
        last: carry after the last tick.
    """
    status = scenario.reference.final_status(last.status)
    metrics = finish(last.sums, last.state, last.reached, scenario.clock.dt, status)
    if last.known is not None:
        judged = close_navigation(last.known.sums)
        metrics = dataclasses.replace(metrics, navigation=judged)
    if last.flight is None:
        return metrics
    flight = close_flight(last.flight, scenario.initial_state, last.state)
    return dataclasses.replace(metrics, flight=flight)


def sparse_checkpoints(ticks: int) -> int:
    """A `checkpoint_every` with which a gradient needs the least memory.

    About 2√n states are kept of n ticks, where n has a divisor near its root. A prime
    number of ticks has none: then 1 or n.
    """
    divisors = (d for d in range(1, ticks + 1) if ticks % d == 0)
    return min(divisors, key=lambda d: d + ticks // d)


def simulate(
    loop: ClosedLoop,
    sea: BodyAxes[Float[Array, " n"]],
    noise: SensorErrors | None = None,
    *,
    keep_every: int = 1,
) -> Trajectory:
    """Roll a closed loop out and keep every tick, or every nth of a long run.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
        noise: the realised errors of the sensors, `loop.scenario.noise(key)`, or None.
        keep_every: ticks from one that is kept to the next; divides their number.
            Metrics are of all ticks, whatever is kept.

    Raises:
        ValueError: `keep_every` does not divide the number of ticks.
    """
    metrics, ticks = roll(loop, sea, noise, loop.tick, keep_every=keep_every)
    return Trajectory(ticks, metrics)


def evaluate(
    loop: ClosedLoop,
    sea: BodyAxes[Float[Array, " n"]],
    noise: SensorErrors | None = None,
    *,
    gradient_memory: Scalar | float | None = None,
    checkpoint_every: int = 1,
) -> Metrics:
    """Roll a closed loop out and keep its metrics only.

    Memory does not grow with the horizon, but for what the scan's inputs take. Each
    tick is checkpointed: a gradient recomputes it instead of storing its inside. It
    keeps the state before every tick, or, for long runs, before every nth alone and
    recomputes the others, at the price of a rollout (`sparse_checkpoints`).

    Where a loop oscillates, the exact derivative of a long run grows by orders of
    magnitude with its horizon and predicts nothing. With a gradient memory τ the
    influence of what was t seconds ago is weighed by e^(−t/τ): a biased derivative, a
    far better guide, and the exact one for τ = ∞. Values do not change.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
        noise: the realised errors of the sensors, `loop.scenario.noise(key)`, or None.
        gradient_memory: τ [s]; None for the exact derivative.
        checkpoint_every: ticks from one kept state to the next; divides their number.

    Raises:
        ValueError: `checkpoint_every` does not divide the number of ticks.
    """
    share = None
    if gradient_memory is not None:
        share = jnp.exp(-loop.scenario.clock.dt / gradient_memory)

    # A tick does not ask how many there are: one trace for runs of all lengths.
    any_length = with_ticks(loop, 1)

    def tick(carry: Carry, inputs: TickInput) -> tuple[Carry, None]:
        return _advance(any_length, share, carry, inputs), None

    return roll(loop, sea, noise, tick, checkpoint_every=checkpoint_every)[0]


def with_ticks(loop: ClosedLoop, ticks: int) -> ClosedLoop:
    """The same loop with another number of ticks, and nothing else changed.

    Args:
        loop: closed loop.
        ticks: number of control ticks.
    """
    clock = dataclasses.replace(loop.scenario.clock, ticks=ticks)
    return eqx.tree_at(lambda at: at.scenario.clock, loop, clock)


@traced_once
def _advance(
    loop: ClosedLoop, share: Scalar | None, carry: Carry, inputs: TickInput
) -> Carry:
    """One tick of what goes on, the record of the tick left out."""
    if share is not None:
        carry = _forgetting(carry, share)
    return loop.tick(carry, inputs)[0]


def _forgetting(carry: Carry, share: Scalar) -> Carry:
    """All that acts on later ticks, faded; the sums of the metrics only add up."""
    faded = jax.tree.map(
        lambda x: (
            scale_gradient(x, share) if jnp.issubdtype(x.dtype, jnp.floating) else x
        ),
        carry,
    )
    return dataclasses.replace(
        faded,
        sums=carry.sums,
        flight=carry.flight,
        known=carry.known and dataclasses.replace(faded.known, sums=carry.known.sums),
    )
