"""Violations of a specification: which of its parts a run breaks."""

from collections.abc import Callable

import numpy as np

from jaxglider.control.specification import Specification
from jaxglider.signals import CHANNELS

PARTS = (*CHANNELS, "bank", "saturation")
"""Parts of a specification: the funnel of each channel, bank limit, saturated share."""


def violations(
    column: Callable[[str], np.ndarray],
    failed: np.ndarray,
    specification: Specification | None,
) -> dict[str, np.ndarray]:
    """Flags of members that break each part that there is; failed runs break all.

    Args:
        column: function from the name of a measure, as `depth.time_outside_funnel` or
            `max_roll`, to its values.
        failed: flags of the members that became non-finite.
        specification: specification that the runs were judged by; None for the laws'
            own funnels and nothing else.
    """
    flags = {c: failed | (column(f"{c}.time_outside_funnel") > 0.0) for c in CHANNELS}
    if specification is None:
        return flags
    if specification.largest_roll is not None:
        limit = float(specification.largest_roll)
        flags["bank"] = failed | (column("max_roll") > limit)
    if specification.saturated_share is not None:
        share = float(specification.saturated_share)
        shares = [column(f"{c}.time_saturated") for c in CHANNELS]
        flags["saturation"] = failed | (np.maximum.reduce(shares) > share)
    return flags


def broken(flags: dict[str, np.ndarray]) -> np.ndarray:
    """Flags of members that break any part.

    Args:
        flags: flags of each part.
    """
    return np.logical_or.reduce(list(flags.values()))
