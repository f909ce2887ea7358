"""Robust least squares with priors, and what the residuals say about the answer.

Rows are (measured − predicted)/(σ √τ): σ is the noise of the channel and τ the number
of samples that say the same thing once, its integrated autocorrelation time. Both come
from the residuals themselves, by turns with the fit. Large residuals count less (soft
L1, from two σ on); the rows of the prior are plain. The search is that of
`scipy.optimize.least_squares`, with the Jacobian of JAX.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import OptimizeResult, least_squares

from tuning.identification.information.noise import FIRST, Noise, estimate_noise

Rows = Mapping[str, np.ndarray]
"""Numbers by channel, one row each; a Jacobian has a column for each free number."""
ROBUST = 2.0
"""Residual, in σ, from which a sample counts less than its square."""
ENOUGH = 0.9
"""Share of the samples that the model must reach where the search begins."""


@dataclasses.dataclass(frozen=True)
class Solution:
    """Best coordinates and their uncertainty.

    Attributes:
        x: coordinates.
        covariance: covariance of the coordinates, priors included.
        information: Fisher information of the record alone.
        noise: noise by channel.
        evaluations: number of evaluations of the model.
        converged: whether the search ended by itself.
    """

    x: np.ndarray
    covariance: np.ndarray
    information: np.ndarray
    noise: dict[str, Noise]
    evaluations: int
    converged: bool

    def condition(self) -> float:
        """Condition number of the record's information, its columns of one length.

        Infinite where some combination of the free numbers leaves no trace.
        """
        lengths = np.sqrt(np.diag(self.information))
        if not np.all(lengths > 0.0):
            return float("inf")
        return float(np.linalg.cond(self.information / np.outer(lengths, lengths)))


def remembered(
    linearise: Callable[[np.ndarray], tuple[Rows, Rows]],
) -> Callable[[np.ndarray], tuple[Rows, Rows]]:
    """The same, its last answer kept: a search asks for rows and slopes by turns.

    Args:
        linearise: predicted rows and their Jacobian at some coordinates.
    """
    last: dict[bytes, tuple[Rows, Rows]] = {}

    def model(x: np.ndarray) -> tuple[Rows, Rows]:
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = linearise(x)
        return last[key]

    return model


def solve(
    linearise: Callable[[np.ndarray], tuple[Rows, Rows]],
    measured: Rows,
    size: int,
    rounds: int = 3,
    noise: Mapping[str, Noise] | None = None,
    stretches: Rows | None = None,
) -> Solution:
    """Fit, estimate the noise, and fit again.

    Args:
        linearise: predicted rows and their Jacobian at some coordinates.
        measured: measured rows by channel.
        size: number of coordinates.
        rounds: number of fits.
        noise: noise that is known; estimated otherwise.
        stretches: numbers of the unbroken stretches of the samples, by channel.

    Raises:
        FloatingPointError: the model is not finite where the search begins.
    """
    model = remembered(linearise)
    x, evaluations, converged = np.zeros(size), 0, True
    predicted, _ = model(x)
    finite = np.concatenate([np.isfinite(rows) for rows in predicted.values()])
    if finite.mean() < ENOUGH:
        raise FloatingPointError(
            "the model is not finite where the fit begins: check units and signs of "
            "the record, and that the vehicle is of its kind."
        )
    known = dict(noise or {})
    levels = known or {
        name: Noise(FIRST[name.partition(":")[0]], 1.0, len(rows))
        for name, rows in measured.items()
    }
    for turn in range(rounds):
        result = search(model, measured, levels, x)
        x = result.x
        evaluations += result.nfev
        converged = result.success
        if not known:
            residuals = _residuals(model(x)[0], measured)
            levels = {
                name: estimate_noise(name, r, (stretches or {}).get(name))
                for name, r in residuals.items()
            }
        if known and turn == 0:
            break
    told = information(model, measured, levels, x)
    covariance = np.linalg.inv(told + np.eye(size))
    return Solution(x, covariance, told, levels, evaluations, converged)


def _residuals(predicted: Rows, measured: Rows) -> dict[str, np.ndarray]:
    return {
        name: np.nan_to_num(measured[name] - predicted[name], nan=1e3)
        for name in measured
    }


def _scales(levels: Mapping[str, Noise]) -> dict[str, float]:
    return {n: 1.0 / (v.sigma * v.correlation_time**0.5) for n, v in levels.items()}


def search(
    model: Callable[[np.ndarray], tuple[Rows, Rows]],
    measured: Rows,
    levels: Mapping[str, Noise],
    x: np.ndarray,
    most: int = 60,
) -> OptimizeResult:
    """The least of the robust squares with the rows of the prior.

    Args:
        model: predicted rows and their Jacobian at some coordinates.
        measured: measured rows by channel.
        levels: noise by channel.
        x: coordinates to start from.
        most: largest number of evaluations.
    """
    scale, limits = _scales(levels), _limits(measured, levels, len(x))

    def rows(at: np.ndarray) -> np.ndarray:
        predicted, _ = model(at)
        parts = [scale[n] * (predicted[n] - measured[n]) for n in measured]
        return np.nan_to_num(np.concatenate([*parts, at]), nan=1e3, posinf=1e3)

    def jacobian(at: np.ndarray) -> np.ndarray:
        _, slopes = model(at)
        parts = [scale[n] * slopes[n] for n in measured]
        return np.nan_to_num(np.concatenate([*parts, np.eye(len(at))]))

    def loss(z: np.ndarray) -> np.ndarray:
        return soft_l1(z, limits)

    return least_squares(
        rows,
        x,
        jac=jacobian,
        x_scale="jac",
        loss=loss,
        max_nfev=most,
        xtol=1e-6,
        ftol=1e-7,
        gtol=1e-7,
    )


def _limits(measured: Rows, levels: Mapping[str, Noise], size: int) -> np.ndarray:
    """c² of each row, infinite for those of the prior."""
    rows = [
        np.full(len(measured[n]), ROBUST**2 / levels[n].correlation_time)
        for n in measured
    ]
    return np.concatenate([*rows, np.full(size, np.inf)])


def loss_of(
    model: Callable[[np.ndarray], tuple[Rows, Rows]],
    measured: Rows,
    levels: Mapping[str, Noise],
    x: np.ndarray,
) -> float:
    """Twice the loss at some coordinates, the prior included.

    Args:
        model: predicted rows and their Jacobian at some coordinates.
        measured: measured rows by channel.
        levels: noise by channel.
        x: coordinates.
    """
    predicted, _ = model(x)
    scale = _scales(levels)
    parts = [scale[n] * (predicted[n] - measured[n]) for n in measured]
    rows = np.nan_to_num(np.concatenate([*parts, x]), nan=1e3, posinf=1e3)
    return float(np.sum(soft_l1(rows**2, _limits(measured, levels, len(x)))[0]))


def soft_l1(z: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """ρ = 2 c² (√(1 + z/c²) − 1) and its two derivatives; z itself for infinite c².

    Args:
        z: squared residuals.
        limits: c², one for each.
    """
    share = 1.0 + z / limits
    plain = np.isinf(limits)
    safe = np.where(plain, 1.0, limits)
    return np.stack(
        [
            np.where(plain, z, 2.0 * safe * (np.sqrt(share) - 1.0)),
            share**-0.5,
            np.where(plain, 0.0, -0.5 * share**-1.5 / safe),
        ]
    )


def information(
    model: Callable[[np.ndarray], tuple[Rows, Rows]],
    measured: Rows,
    levels: Mapping[str, Noise],
    x: np.ndarray,
) -> np.ndarray:
    """JᵀJ of the measured rows alone.

    Args:
        model: predicted rows and their Jacobian at some coordinates.
        measured: measured rows by channel.
        levels: noise by channel.
        x: coordinates.
    """
    _, slopes = model(x)
    scale = _scales(levels)
    total = np.zeros((len(x), len(x)))
    for name in measured:
        rows = np.nan_to_num(scale[name] * slopes[name])
        total += rows.T @ rows
    return total


def joined(solutions: Sequence[Solution]) -> Solution:
    """Searches one after the other as one: what one held fixed, it knows nothing of.

    Args:
        solutions: solution of each stage.
    """
    return Solution(
        np.concatenate([s.x for s in solutions]),
        block_diag(*(s.covariance for s in solutions)),
        block_diag(*(s.information for s in solutions)),
        {name: noise for s in solutions for name, noise in s.noise.items()},
        sum(s.evaluations for s in solutions),
        all(s.converged for s in solutions),
    )


def correlations(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix of a covariance."""
    lengths = np.sqrt(np.diag(covariance))
    return covariance / np.outer(lengths, lengths)


def strongest_pairs(
    covariance: np.ndarray, names: Sequence[str], least: float = 0.9
) -> list[tuple[str, str, float]]:
    """Pairs of numbers that the record cannot tell apart, the strongest first.

    Args:
        covariance: covariance of the coordinates.
        names: names of the numbers.
        least: smallest modulus of a correlation that counts.
    """
    matrix = correlations(covariance)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) >= least
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))
