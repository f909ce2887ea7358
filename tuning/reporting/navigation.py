"""Knowledge of a glider with sensors of itself, as text."""

from typing import Any

from tuning.reporting.tables import DEGREE, decimals, markdown_table, text_columns

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
    table = text_columns(["", *(title for title, *_ in _ERRORS)], _rows(run), 23)
    about = "errors (rms) of what is known on board"
    return "\n".join([about, *table, *_reckoning(run)])


def markdown_navigation(run: dict[str, Any]) -> list[str]:
    """The same as Markdown."""
    if "navigation" not in run:
        return []
    head = f"\n### What {run['controller']} knew in {run['scenario']}\n"
    titles = ["errors (rms)", *(title for title, *_ in _ERRORS)]
    table = markdown_table(titles, _rows(run), 1)
    return [head, *table, "", *(f"- {line}" for line in _reckoning(run))]


def _rows(run: dict[str, Any]) -> list[list[str]]:
    told = run["navigation"]
    return [
        [
            name,
            *(decimals(told[table][k], digits, f) for _, k, f, digits in _ERRORS),
        ]
        for table, name in _TIMES.items()
    ]


def _reckoning(run: dict[str, Any]) -> list[str]:
    """Misses at surfacings and the current, if the glider has surfaced."""
    told = run["navigation"]
    if not told["surfacings"]:
        return []
    return [
        f"reckoning: {told['surfacings']:.0f} surfacings, missed by "
        f"{decimals(told['miss_m'], 0)} m in the mean, "
        f"{decimals(told['miss_share'], 1, 100.0)} % of the way; current known to "
        f"{decimals(told['current_error_m_s'], 1, 100.0)} cm/s"
    ]
