"""Rank correlations of uncertain numbers with trouble, over the members."""

from typing import Any

import numpy as np
from scipy import special

from jaxglider.signals import CHANNELS
from tuning.campaign.analysis.summary import severity
from tuning.campaign.run.rows import Rows

SEVERITY = "severity"
"""Name of the largest error over the edge of its funnel, over all channels."""
LEFT = "left_funnel"
"""Name of whether a funnel was left, 1 or 0; failures did."""
OUTPUTS = (
    LEFT,
    SEVERITY,
    *(f"{channel}.rms_error" for channel in CHANNELS),
    "max_roll",
)
"""Results whose drivers are looked for."""


def output(table: Rows, number: int, name: str) -> np.ndarray:
    """One of `OUTPUTS` of each member; infinite for runs that failed.

    Args:
        table: rows of the campaign.
        number: number of the set of gains.
        name: name of the output.
    """
    if name == LEFT:
        return table.left_funnel(number).astype(float)
    if name == SEVERITY:
        return severity(table, number)
    return table.column(number, name)


def _ranked(values: np.ndarray) -> np.ndarray:
    """Ranks from one on, the mean of them for equal values."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1))[places]


def rank_correlations(values: np.ndarray, result: np.ndarray) -> dict[str, Any]:
    """Spearman's correlation of each uncertain number with a result.

    Interval: tanh(artanh r ± 1.96 √((1 + r²/2)/(n − 3))), Bonett and Wright (2000).
    Runs that failed rank highest.

    Args:
        values: values of the uncertain numbers, one row a member, one column a number.
        result: result of each member.

    Returns:
        `rho`, `low` and `high`, one number a column; zero where nothing varies.
    """
    n = len(result)
    ranks = _ranked(result)
    columns = np.apply_along_axis(_ranked, 0, values)
    spread = columns.std(axis=0) * ranks.std()
    joint = (columns * (ranks - ranks.mean())[:, None]).mean(axis=0)
    rho = np.divide(joint, spread, out=np.zeros(values.shape[1]), where=spread > 0.0)
    inside = np.clip(rho, -1.0 + 1e-12, 1.0 - 1e-12)
    half = special.ndtri(0.975) * np.sqrt((1.0 + rho**2 / 2.0) / max(n - 3, 1))
    return {
        "rho": rho,
        "low": np.tanh(np.arctanh(inside) - half),
        "high": np.tanh(np.arctanh(inside) + half),
    }


def drivers(table: Rows, names: tuple[str, ...], number: int) -> dict[str, Any]:
    """The rank correlations with each output, largest modulus first.

    Args:
        table: rows of the campaign.
        names: names of the uncertain numbers.
        number: number of the set of gains.
    """
    tables = {}
    values = np.array(table.rows["values"])
    for name in OUTPUTS:
        ranked = rank_correlations(values, output(table, number, name))
        order = np.argsort(-np.abs(ranked["rho"]), kind="stable")
        tables[name] = [
            {
                "quantity": names[j],
                "rho": float(ranked["rho"][j]),
                "interval": [float(ranked["low"][j]), float(ranked["high"][j])],
            }
            for j in order
        ]
    return tables
