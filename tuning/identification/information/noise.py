"""Noise of a channel and its correlation in time, from the residuals of a fit."""

import dataclasses

import numpy as np

FLOORS = {
    "depth_rate": 5e-4,
    "speed": 2e-3,
    "pitch": 5e-4,
    "roll": 5e-4,
    "turn_rate": 1e-5,
}
"""Smallest noise that a channel is taken to have, in its unit."""
FIRST = {
    "depth_rate": 0.01,
    "speed": 0.03,
    "pitch": 0.03,
    "roll": 0.03,
    "turn_rate": 2e-3,
}
"""Noise of each channel that the first round assumes."""


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise of a channel as the residuals show it.

    Attributes:
        sigma: σ, standard deviation, robust.
        correlation_time: τ, in samples; at least 1.
        count: number of samples.
    """

    sigma: float
    correlation_time: float
    count: int

    def independent(self) -> float:
        """Number of samples that say something new."""
        return self.count / self.correlation_time


def estimate_noise(
    name: str, residuals: np.ndarray, stretches: np.ndarray | None = None
) -> Noise:
    """Noise of a channel: 1.48 times the median deviation, and its correlation.

    τ = 1 + 2 Σ ρ_k, over the lags until ρ first falls below 0.05, and at least that of
    a first-order process, (1 + ρ₁)/(1 − ρ₁): a short record's ρ falls too early.

    Args:
        name: name of the channel.
        residuals: measured less predicted, in order of time.
        stretches: number of the unbroken stretch that each is of; one for all if left
            out.
    """
    group = name.partition(":")[0]
    middle = 1.4826 * float(np.median(np.abs(residuals)))
    sigma = max(middle, FLOORS.get(group, 1e-9))
    centred = np.clip(residuals - np.median(residuals), -4.0 * sigma, 4.0 * sigma)
    same = np.zeros(len(residuals)) if stretches is None else stretches
    whole = float(np.mean(centred**2))
    if whole <= 0.0 or len(centred) < 8:
        return Noise(sigma, 1.0, len(residuals))
    total, first = 1.0, 0.0
    for lag in range(1, len(centred) // 4):
        pairs = same[lag:] == same[:-lag]
        if not pairs.any():
            break
        share = float(np.mean((centred[lag:] * centred[:-lag])[pairs])) / whole
        first = share if lag == 1 else first
        if share < 0.05:
            break
        total += 2.0 * share
    first = min(max(first, 0.0), 0.98)
    return Noise(sigma, max(total, (1.0 + first) / (1.0 - first)), len(residuals))
