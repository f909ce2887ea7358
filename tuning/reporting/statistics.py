"""Statistics of a population from members drawn at random, with intervals.

| of | estimate | interval |
|---|---|---|
| probability | k/n | Clopper and Pearson (1934): exact, covers at least what it says |
| quantile | order statistic | two order statistics, by the binomial distribution |
| CVaR | mean of the worst share | normal, by its influence function |
| mean of paired differences | mean | Student |
| who wins | wins/(wins + losses) | Clopper and Pearson |

An infinite number stands for a run that failed: worse than all others, never left out.

Quantiles come from `scipy.special`: to import `scipy.stats` takes a second.
"""

import math
from typing import Any

import numpy as np
from scipy import special

LEVEL = 0.95
"""Confidence of every interval, unless said otherwise."""


def clopper_pearson(
    successes: int, trials: int, level: float = LEVEL
) -> tuple[float, float]:
    """The exact interval of a probability from k successes in n independent trials.

    [B(α/2; k, n − k + 1), B(1 − α/2; k + 1, n − k)], B quantiles of the beta
    distribution.

    Args:
        successes: k.
        trials: n.
        level: level of confidence, 1 − α.

    Raises:
        ValueError: not 0 ≤ k ≤ n with n ≥ 1.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(
            "successes must be in [0, trials], trials at least 1; received "
            f"{successes} of {trials}."
        )
    tail = (1.0 - level) / 2.0
    k, n = successes, trials
    low = 0.0 if k == 0 else float(special.betaincinv(k, n - k + 1, tail))
    high = 1.0 if k == n else float(special.betaincinv(k + 1, n - k, 1.0 - tail))
    return low, high


def probability(events: np.ndarray, level: float = LEVEL) -> dict[str, Any]:
    """Frequency of an event, and the interval of its probability."""
    k, n = int(np.sum(events)), len(events)
    return {
        "k": k,
        "n": n,
        "p": k / n,
        "interval": list(clopper_pearson(k, n, level)),
    }


def bonferroni(level: float, intervals: int) -> float:
    """Level of each of some intervals so that all hold at once at a level.

    1 − (1 − level)/m: the chance that any of m misses is at most the sum of theirs,
    whatever they have to do with each other.

    Args:
        level: level of confidence of all together.
        intervals: m, number of intervals.
    """
    return 1.0 - (1.0 - level) / intervals


def quantile(values: np.ndarray, share: float, level: float = LEVEL) -> dict[str, Any]:
    """A quantile and the two order statistics that enclose it.

    X_(l) ≤ q ≤ X_(u) with at least the level's probability, l and u from the binomial
    distribution of the number of n values below q. An end that n is too small for is
    None.

    Args:
        values: values, which may be infinite.
        share: share of the values below the quantile, in (0, 1).
        level: level of confidence.
    """
    ordered, n = np.sort(values), len(values)
    tail = (1.0 - level) / 2.0
    low = _binomial_quantile(tail, n, share)
    high = _binomial_quantile(1.0 - tail, n, share) + 1
    # In the counting from one: low = 0 and high = n + 1 are no order statistics.
    return {
        "value": plain(ordered[max(math.ceil(share * n), 1) - 1]),
        "interval": [
            plain(ordered[low - 1]) if low >= 1 else None,
            plain(ordered[high - 1]) if high <= n else None,
        ],
    }


def _binomial_quantile(level: float, n: int, share: float) -> int:
    """The smallest k with P(X ≤ k) of at least a level, to rounding, of n trials."""
    k = max(math.ceil(special.bdtrik(level, n, share)), 0)
    enough = level * (1.0 - 1e-12)
    return k - 1 if k > 0 and special.bdtr(k - 1, n, share) >= enough else k


def student_half_width(differences: np.ndarray, level: float = LEVEL) -> float:
    """Half of Student's interval of a mean, from two differences or more."""
    n = len(differences)
    quantile = float(special.stdtrit(n - 1, 0.5 + level / 2.0))
    return quantile * float(differences.std(ddof=1)) / math.sqrt(n)


def cvar(
    values: np.ndarray, share: float = 0.05, level: float = LEVEL
) -> dict[str, Any]:
    """The mean of the worst share of the values: conditional value at risk.

    CVaR = q + E[max(x − q, 0)]/share, q the quantile at 1 − share. None where a failed
    run is among the worst share: the mean is infinite.

    Args:
        values: values, which may be infinite.
        share: share of the values that count.
        level: level of confidence.
    """
    n = len(values)
    q = np.sort(values)[max(math.ceil((1.0 - share) * n), 1) - 1]
    if not np.all(np.isfinite(values)):
        return {"value": None, "interval": None}
    excess = np.maximum(values - q, 0.0) / share
    centre = float(q + excess.mean())
    if n < 2:
        return {"value": centre, "interval": None}
    half = float(special.ndtri(0.5 + level / 2.0) * excess.std(ddof=1) / math.sqrt(n))
    return {"value": centre, "interval": [centre - half, centre + half]}


def spread(values: np.ndarray, level: float = LEVEL) -> dict[str, Any]:
    """Mean, quantiles with intervals, CVaR and the worst of a measure.

    Args:
        values: measure of each member; infinite where it failed, NaN where it has none,
            and left out. All is None where no member has one.
        level: level of confidence.
    """
    values = values[~np.isnan(values)]
    if not len(values):
        nothing = {"value": None, "interval": None}
        names = ("q05", "q50", "q95", "q99", "cvar95")
        return {"mean": None, **dict.fromkeys(names, nothing), "worst": None}
    known = values[np.isfinite(values)]
    return {
        "mean": float(known.mean()) if len(known) == len(values) else None,
        "q05": quantile(values, 0.05, level),
        "q50": quantile(values, 0.50, level),
        "q95": quantile(values, 0.95, level),
        "q99": quantile(values, 0.99, level),
        "cvar95": cvar(values, 0.05, level),
        "worst": plain(values.max()),
    }


def paired_difference(first: np.ndarray, second: np.ndarray) -> dict[str, Any]:
    """Two sets of gains on the same members: how much less, and how often, the second.

    The difference, second − first, is over the pairs in which neither failed; who wins
    is over all, a failed run losing against one that did not fail.

    Args:
        first: value of each member, infinite where it failed.
        second: second value of each member, infinite where it failed.
    """
    usable = np.isfinite(first) & np.isfinite(second)
    difference = second[usable] - first[usable]
    wins, losses = int(np.sum(second < first)), int(np.sum(second > first))
    table: dict[str, Any] = {
        "pairs": len(difference),
        "difference": float(difference.mean()) if len(difference) else None,
        "interval": None,
        "wins": wins,
        "losses": losses,
        "ties": len(first) - wins - losses,
        "win_rate": None,
        "win_interval": None,
    }
    if len(difference) > 1:
        half = student_half_width(difference)
        centre = table["difference"]
        table["interval"] = [float(centre - half), float(centre + half)]
    if wins + losses:
        table["win_rate"] = wins / (wins + losses)
        table["win_interval"] = list(clopper_pearson(wins, wins + losses))
    return table


def discordant(first: np.ndarray, second: np.ndarray) -> dict[str, Any]:
    """Events of two sets of gains on the same members: McNemar's exact test.

    Args:
        first: flag of each member, the event happened with the first set.
        second: flag of each member, the event happened with the second set.
    """
    only_first = int(np.sum(first & ~second))
    only_second = int(np.sum(~first & second))
    total = only_first + only_second
    # Both tails of a fair coin, which is symmetric.
    tail = float(special.bdtr(min(only_first, only_second), total, 0.5))
    value = min(2.0 * tail, 1.0)
    return {
        "only_first": only_first,
        "only_second": only_second,
        "difference": float(second.mean() - first.mean()),
        "p_value": value,
    }


def plain(value: Any) -> float | None:
    """A finite number, or None."""
    number = float(value)
    return number if math.isfinite(number) else None
