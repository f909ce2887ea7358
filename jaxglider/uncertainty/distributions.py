"""Distributions of one uncertain number, given by their quantile functions.

A member of an ensemble is a point u of the unit cube; each of its coordinates becomes a
number through x = F⁻¹(u). Whatever places the points (independent draws, Latin
hypercube, Sobol sequence) then serves every distribution.

Plain NumPy in double precision on the host: a member is the same number for number on
every device and in both precisions of the rollout.
"""

import dataclasses
from abc import abstractmethod
from typing import Any

import numpy as np

from jaxglider.core.containers import check_finite, check_interval

_GRID = (np.arange(4096) + 0.5) / 4096


class AbstractDistribution:
    """A distribution with a quantile function."""

    @abstractmethod
    def quantile(self, u: Any) -> np.ndarray:
        """F⁻¹(u), elementwise, for u in (0, 1)."""

    def support(self) -> tuple[float, float]:
        """The smallest and the largest value."""
        ends = self.quantile(np.array([0.0, 1.0]))
        return float(ends.min()), float(ends.max())

    def middle(self) -> float:
        """F⁻¹(½)."""
        return float(self.quantile(np.array([0.5]))[0])

    def standard_deviation(self) -> float:
        """σ, from 4096 equally likely quantiles: within 0.1 % for those here."""
        return float(np.std(self.quantile(_GRID)))


@dataclasses.dataclass(frozen=True)
class Uniform(AbstractDistribution):
    """Equally likely between two ends, x = a + (b − a) u.

    Attributes:
        low: a.
        high: b.

    Raises:
        ValueError: an end is not finite, or a > b.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        check_finite("Uniform", "low", self.low)
        check_finite("Uniform", "high", self.high)
        check_interval("Uniform", "high", self.high, self.low, closed_low=True)

    def quantile(self, u: Any) -> np.ndarray:
        """a + (b − a) u."""
        return self.low + (self.high - self.low) * np.asarray(u, np.float64)


@dataclasses.dataclass(frozen=True)
class TruncatedNormal(AbstractDistribution):
    """Normal, cut k standard deviations from its mean: x = m + s Φ⁻¹(a + (1 − 2a) u).

    a = Φ(−k). The cut keeps masses positive; it lowers σ below s.

    Attributes:
        mean: m.
        deviation: s > 0, of the normal before it is cut.
        truncation: k > 0.

    Raises:
        ValueError: a number is outside its range.
    """

    mean: float
    deviation: float
    truncation: float = 3.0

    def __post_init__(self) -> None:
        check_finite("TruncatedNormal", "mean", self.mean)
        _check_spread("TruncatedNormal", self.deviation, self.truncation)

    def quantile(self, u: Any) -> np.ndarray:
        """m + s z with the cut normal z."""
        return self.mean + self.deviation * _cut_normal(u, self.truncation)


@dataclasses.dataclass(frozen=True)
class LogNormal(AbstractDistribution):
    """The logarithm is a cut normal: x = m exp(s z), z as for `TruncatedNormal`.

    Attributes:
        median: m > 0.
        deviation: s > 0, of ln x before it is cut.
        truncation: k > 0, in standard deviations of ln x.

    Raises:
        ValueError: a number is outside its range.
    """

    median: float
    deviation: float
    truncation: float = 3.0

    def __post_init__(self) -> None:
        check_interval("LogNormal", "median", self.median, 0.0)
        check_finite("LogNormal", "median", self.median)
        _check_spread("LogNormal", self.deviation, self.truncation)

    def quantile(self, u: Any) -> np.ndarray:
        """m exp(s z)."""
        return self.median * np.exp(self.deviation * _cut_normal(u, self.truncation))


@dataclasses.dataclass(frozen=True)
class Mixture(AbstractDistribution):
    """With probability p as another distribution says, else one fixed value.

    Attributes:
        probability: p in [0, 1].
        then: the distribution in that case, F⁻¹(u/p) for u < p.
        otherwise: the value in the other case.

    Raises:
        ValueError: p outside [0, 1].
    """

    probability: float
    then: AbstractDistribution
    otherwise: float

    def __post_init__(self) -> None:
        check_interval(
            "Sometimes",
            "probability",
            self.probability,
            0.0,
            1.0,
            closed_low=True,
            closed_high=True,
        )

    def quantile(self, u: Any) -> np.ndarray:
        """F⁻¹(u/p) where u < p, the fixed value elsewhere."""
        u = np.asarray(u, np.float64)
        inner = u / self.probability if self.probability > 0.0 else u
        happens = u < self.probability
        return np.where(
            happens, self.then.quantile(np.minimum(inner, 1.0)), self.otherwise
        )

    def support(self) -> tuple[float, float]:
        """That of the other distribution, stretched to hold the fixed value."""
        low, high = self.then.support()
        return min(low, self.otherwise), max(high, self.otherwise)


def correlated(u: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """Coordinates with a Gaussian copula: u' = Φ(L Φ⁻¹(u)), L Lᵀ = R.

    Each column stays uniform; R is the correlation of the normal scores.

    Args:
        u: independent coordinates in (0, 1), one row a member.
        correlation: R, symmetric and positive definite with ones on its diagonal.

    Raises:
        ValueError: R is no such matrix.
    """
    from scipy import special

    scores = special.ndtri(u)
    # Sums in one order: a matrix product rounds a row as its neighbours have it.
    mixed = [
        sum(weight * scores[:, j] for j, weight in enumerate(row[: i + 1]))
        for i, row in enumerate(_factor(correlation))
    ]
    return special.ndtr(np.stack(mixed, axis=1))


def _factor(correlation: np.ndarray) -> np.ndarray:
    matrix = np.asarray(correlation, np.float64)
    square = matrix.ndim == 2 and matrix.shape[0] == matrix.shape[1]
    if square and np.allclose(matrix, matrix.T) and np.allclose(np.diag(matrix), 1.0):
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            pass
    raise ValueError(
        "correlation must be a symmetric positive definite matrix with ones on its "
        f"diagonal; received {matrix.tolist()}."
    )


def _cut_normal(u: Any, truncation: float) -> np.ndarray:
    # On first use: SciPy changes the process's warnings when it is imported.
    from scipy import special

    tail = special.ndtr(-truncation)
    return special.ndtri(tail + (1.0 - 2.0 * tail) * np.asarray(u, np.float64))


def _check_spread(owner: str, deviation: float, truncation: float) -> None:
    for name, value in (("deviation", deviation), ("truncation", truncation)):
        check_interval(owner, name, value, 0.0)
        check_finite(owner, name, value)
