"""Table of settling: the time required, the bound of theory, the time seen."""

import numpy as np

from jaxglider.control import FxTPPC, tian_exponents
from jaxglider.signals import CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory


def settling_table(tuned: ClosedLoop, runs: dict[str, Trajectory]) -> list[str]:
    """Rows of a table for FxTPPC: the theory's bound beside what was seen.

    Args:
        tuned: closed loop with the tuned gains.
        runs: nominal runs `before` and `after`, on the host.
    """
    law = getattr(tuned.controller, "law", tuned.controller)
    if not isinstance(law, FxTPPC):
        return []
    specification = tuned.scenario.specification
    rows = [
        "| channel | required [s] | surface s, 1.209 mu/(k1 + k2) [s] | error seen: "
        "longest time to stay within the specified final bound, nominal [s] |",
        "|---|---:|---:|---:|",
    ]
    for channel in CHANNELS:
        required = None
        if specification is not None:
            required = getattr(specification.required_settling(), channel)
        bound = float(getattr(law.gains, channel).settling_bound())
        rows.append(
            f"| {channel} | {'-' if required is None else f'{float(required):.4g}'} | "
            f"{bound:.4g} | {settling_seen(runs['after'], channel)} |"
        )
    return [
        *rows,
        "\nThe bound is on the surface, from however far away, with the disturbance "
        "known and the actuators unlimited. On s = 0 the error then follows "
        f"{_on_the_surface(law)}",
    ]


def _on_the_surface(law: FxTPPC) -> str:
    """Words on the error on s = 0, by the pairing of the exponents."""
    if law.exponents is tian_exponents:
        return "within a time that does not depend on how large it is (Tian's pairing)."
    return (
        "in a time that grows with its size without end: the paper's pairing of the "
        "exponents is not fixed-time there."
    )


def settling_seen(run: Trajectory, channel: str) -> str:
    """Time after a funnel's restart at which an error last left its final bound [s]."""
    ticks = run.ticks
    active = np.asarray(ticks.active)
    limits = getattr(ticks.limits, channel)
    lower, upper = np.asarray(limits.lower)[active], np.asarray(limits.upper)[active]
    error = np.asarray(getattr(ticks.error, channel))[active]
    clock = np.asarray(ticks.clock)[active]
    outside = (error < lower.max()) | (error > upper.min())
    if not np.any(outside):
        return "0.0"
    return f"{clock[outside].max():.1f}"
