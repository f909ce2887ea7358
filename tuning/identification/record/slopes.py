"""Rates from samples: the slope of a local parabola (Savitzky and Golay 1964).

The same filter is put on the rate of a model, so that turns are compared alike.
"""

import numpy as np


def slope(values: np.ndarray, half: int, dt: float) -> np.ndarray:
    """Slope of the parabola through 2 half + 1 samples, the ends held.

    Args:
        values: samples, evenly spaced.
        half: steps on either side.
        dt: time step [s].
    """
    weights = np.arange(-half, half + 1) / (dt * half * (half + 1) * (2 * half + 1) / 3)
    return np.convolve(np.pad(values, half, mode="edge"), weights[::-1], mode="valid")


def kernel(half: int) -> np.ndarray:
    """Weights on the depth rate that equal the slope of the parabola on the depth.

    Σ i z_i / Σ i², with z the trapezoidal sum of the rate: weights (n(n+1) − j(j−1))/2
    on the means of neighbours.

    Args:
        half: n, steps on either side.
    """
    j = np.arange(-half + 1, half + 1)
    middles = 0.5 * (half * (half + 1) - j * (j - 1))
    weights = np.convolve(middles, [0.5, 0.5])
    return weights / weights.sum()
