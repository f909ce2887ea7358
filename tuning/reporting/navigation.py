"""Knowledge of a glider with sensors of itself, as text."""

import math
from typing import Any

from tuning.reporting.tables import markdown_table

DEGREE = 180.0 / math.pi
_ERRORS = (
    # title, key, factor, digits
    ("depth [m]", "depth_m", 1.0, 3),
    ("w [cm/s]", "depth_rate_m_s", 100.0, 2),
    ("surge [cm/s]", "surge_m_s", 100.0, 2),
    ("sway [cm/s]", "sway_m_s", 100.0, 2),
    ("heave [cm/s]", "heave_m_s", 100.0, 2),
    ("pitch [deg]", "pitch_rad", DEGREE, 2),
    ("heading [deg]", "heading_rad", DEGREE, 2),
    ("yaw rate [deg/s]", "yaw_rate_rad_s", DEGREE, 3),
)
_TIMES = {"steady_rms": "steady", "after_rms": "40 s after inflections"}


def text_navigation(run: dict[str, Any]) -> str:
    """Errors of what was known on board, for a terminal; nothing without sensors."""
    if "navigation" not in run:
        return ""
    rows = _rows(run)
    widths = [len(title) + 2 for title, *_ in _ERRORS]
    titles = [title for title, *_ in _ERRORS]
    lines = ["errors (rms) of what is known on board"]
    for name, cells in [("", titles), *rows]:
        parts = (f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))
        lines.append(f"{name:<23}" + "".join(parts))
    return "\n".join([*lines, *_reckoning(run)])


def markdown_navigation(run: dict[str, Any]) -> list[str]:
    """The same as Markdown."""
    if "navigation" not in run:
        return []
    head = f"\n### What {run['controller']} knew in {run['scenario']}\n"
    rows = [[name, *cells] for name, cells in _rows(run)]
    table = markdown_table(["errors (rms)", *(t for t, *_ in _ERRORS)], rows, 1)
    return [head, *table, "", *(f"- {line}" for line in _reckoning(run))]


def _rows(run: dict[str, Any]) -> list[tuple[str, list[str]]]:
    told = run["navigation"]
    return [
        (
            name,
            [
                _figure(told[table][key], factor, digits)
                for _, key, factor, digits in _ERRORS
            ],
        )
        for table, name in _TIMES.items()
    ]


def _reckoning(run: dict[str, Any]) -> list[str]:
    """Misses at surfacings and the current, if the glider has surfaced."""
    told = run["navigation"]
    if not told["surfacings"]:
        return []
    return [
        f"reckoning: {told['surfacings']:.0f} surfacings, missed by "
        f"{_figure(told['miss_m'], 1.0, 0)} m in the mean, "
        f"{_figure(told['miss_share'], 100.0, 1)} % of the way; current known to "
        f"{_figure(told['current_error_m_s'], 100.0, 1)} cm/s"
    ]


def _figure(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"
