"""Change of a gradient with the horizon and with the smoothing width."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.batching import map_members
from tuning.gradient_check.probe import percent

Loss = Callable[[Any], Any]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Value and gradient of several losses at one point, a row for each.

    Attributes:
        what: number in which the losses differ, with its unit.
        at: horizon [s] or smoothing width of each loss, rising.
        values: J.
        gradients: gradients of J, per unit of each free number.
        verdict: conclusion in a sentence.
    """

    what: str
    at: np.ndarray
    values: np.ndarray
    gradients: np.ndarray
    verdict: str

    @property
    def norms(self) -> np.ndarray:
        """Gradient norms."""
        return np.asarray(np.linalg.norm(self.gradients, axis=1))

    @property
    def alignment(self) -> np.ndarray:
        """Cosine of the angle between each gradient and that of the row before."""
        return _alignment(self.gradients)


def compare_horizons(losses: Mapping[float, Loss], free: Any) -> Comparison:
    """Growth of the gradient with the length of the run; one program per horizon.

    Args:
        losses: J by horizon [s].
        free: the free numbers.
    """
    at, free = np.asarray(sorted(losses), dtype=float), jnp.asarray(free)
    rows = [jax.jit(jax.value_and_grad(losses[horizon]))(free) for horizon in at]
    values, gradients = map(np.asarray, zip(*jax.device_get(rows), strict=True))
    norms = np.linalg.norm(gradients, axis=1)
    verdict = "not finite on some horizon: do not trust it there"
    if np.all(np.isfinite(norms)):
        growth, longer = norms[-1] / max(norms[0], np.finfo(float).tiny), at[-1] / at[0]
        calm = growth <= 3.0 * longer
        verdict = (
            f"{growth:.3g} times the gradient on {longer:.3g} times the horizon: "
            + (
                "bounded"
                if calm
                else "it explodes; average over copies or shorten the run"
            )
        )
    return Comparison(
        what="horizon [s]", at=at, values=values, gradients=gradients, verdict=verdict
    )


def compare_smoothing(
    loss: Callable[[Any, Any], Any], widths: Sequence[float], free: Any
) -> Comparison:
    """Influence of the smoothing width on J and its gradient.

    Args:
        loss: J of the free numbers and of the smoothing width.
        widths: the smoothing widths δ.
        free: the free numbers.
    """
    at = np.sort(np.asarray(widths, dtype=float))
    free = jnp.asarray(free)

    @jax.jit
    def slope(deltas: Any) -> Any:
        return map_members(lambda d: jax.value_and_grad(loss)(free, d), deltas)

    values, gradients = jax.device_get(slope(jnp.asarray(at, free.dtype)))
    return _judge_smoothing(at, np.asarray(values), np.asarray(gradients))


def _judge_smoothing(
    at: np.ndarray, values: np.ndarray, gradients: np.ndarray
) -> Comparison:
    verdict = "not finite at some width: do not trust it there"
    if np.all(np.isfinite(gradients)) and np.all(np.isfinite(values)):
        size = max(np.max(np.abs(values)), np.finfo(float).tiny)
        change = float(np.ptp(values) / size)
        turn = float(np.min(_alignment(gradients)[1:], initial=1.0))
        calm = change <= 0.1 and turn >= 0.9
        verdict = (
            f"J changes by {percent(change)}, alignment of gradients {turn:.2f}: "
            + (
                "insensitive"
                if calm
                else "it depends on the width; tune at the final one"
            )
        )
    return Comparison(
        what="smoothing width",
        at=at,
        values=values,
        gradients=gradients,
        verdict=verdict,
    )


def _alignment(gradients: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(gradients, axis=1)
    dots = np.sum(gradients[1:] * gradients[:-1], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.concatenate([[1.0], dots / (norms[1:] * norms[:-1])])
