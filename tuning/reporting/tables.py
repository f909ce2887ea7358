"""Results as tables for a terminal and as Markdown."""

import math
from collections.abc import Sequence
from typing import Any

from jaxglider import paper
from jaxglider.signals import CHANNEL_UNITS, COMMAND_UNITS

DEGREE = 180.0 / math.pi
"""Degrees in a radian."""
CAVEAT = (
    "The printed values are shown as they stand in the paper. Its transient values are "
    "partly below its own root mean square of the same error, its heading efforts lie "
    "above the actuator's limit of pi/2 and its SMC heading errors above pi: its units "
    "or windows are not those it defines, so read the columns side by side with care."
)
RMS_ERROR, RMS_COMMAND, RMS_STEP = "rms error", "rms command", "rms command step"
"""Names of L2[e], L2[U] and L2[dU] in tables."""
OUTSIDE = "share of time outside"
"""Name of the share of the time that an error is outside the specification's funnel."""
_PAPER_ROWS = {
    "transient": ("max_error", "largest error"),
    "average_tracking": ("rms_error", RMS_ERROR),
    "average_effort": ("rms_effort", RMS_COMMAND),
    "chattering": ("chattering", RMS_STEP),
}
_OWN_ROWS = {
    "max_error_settled": ("max_error_settled", "largest error once settled"),
    "travel": ("travel", "travel"),
    "time_outside_funnel": ("time_outside_funnel", OUTSIDE),
    "time_saturated": ("time_saturated", "share of time saturated"),
}
_COLUMNS = {
    "max_error": ("largest", "error"),
    "max_error_settled": ("once", "settled"),
    "rms_error": ("rms", "error"),
    "rms_effort": ("rms", "command"),
    "chattering": ("rms command", "step"),
    "travel": ("", "travel"),
    "time_outside_funnel": ("share of time", "outside"),
}
"""Two lines of the title of each column."""
_OF_COMMAND = ("rms_effort", "chattering", "travel")
COMMAND_NOTE = (
    "rms command, its step and travel: ballast [kg], mass position [m], mass angle "
    "[rad]."
)
"""Units of commands, where a row has the unit of its error."""
UNSETTLED = (
    "settled -: the specification's funnel never settled, for no segment lasted as "
    "long as its settling time."
)


def unit_of(channel: str, measure: str) -> str:
    """SI unit of a measure: that of its channel, or of the channel's actuator.

    Args:
        channel: `depth`, `pitch` or `heading`.
        measure: field of `ChannelMetrics`.
    """
    if measure in _OF_COMMAND:
        return dict(zip(CHANNEL_UNITS, COMMAND_UNITS.values(), strict=True))[channel]
    return CHANNEL_UNITS[channel]


def headline(scenario: str, vehicle: str, plant: str) -> str:
    """Title of a flight, such as `switching: SeaWing (rigid-body)`.

    Args:
        scenario: name of the case or the mission.
        vehicle: name of the vehicle; empty where nobody said.
        plant: name of the plant.
    """
    return f"{scenario}: {vehicle} ({plant})" if vehicle else f"{scenario} on {plant}"


def _flown(run: dict[str, Any]) -> str:
    return headline(run["scenario"], run.get("vehicle", ""), run["plant"])


def text_table(runs: list[dict[str, Any]]) -> str:
    """Runs of one scenario and plant as text for a terminal."""
    first = runs[0]
    wide = max(10, *(len(r["controller"]) for r in runs)) + 2
    compared = any(_is_printed(run) for run in runs)
    titles = [*_COLUMNS.values(), *([_PRINTED] if compared else [])]
    widths = [max(10, *(len(word) + 2 for word in pair)) for pair in titles]
    above, below = (
        "".join(f"{pair[n]:>{w}}" for pair, w in zip(titles, widths, strict=True))
        for n in (0, 1)
    )
    lines = [
        _flown(first),
        f"{'':<14}{'':<{wide}}{above}",
        f"{'channel':<14}{'controller':<{wide}}{below}",
    ]
    # A glider whose ballast is set once per phase tracks no depth.
    of_yos = any("halves" in run for run in runs)
    for channel, unit in CHANNEL_UNITS.items():
        for run in runs:
            if channel == "depth" and of_yos:
                continue
            measures = run["channels"][channel]
            values = [measures[key] for key in _COLUMNS]
            if compared:
                values.append(_printed(run, channel, "average_tracking"))
            cells = "".join(
                f"{figure(x):>{w}}" for x, w in zip(values, widths, strict=True)
            )
            lines.append(
                f"{f'{channel} [{unit}]':<14}{run['controller']:<{wide}}{cells}"
            )
    lines += [f"{r['controller']:>{wide}}: {outcome(r)}" for r in runs]
    return "\n".join([*lines, COMMAND_NOTE, *_explained(runs)])


_PRINTED = ("rms error", "in the paper")


def _explained(runs: list[dict[str, Any]]) -> list[str]:
    """A line on dashes in the column of settled errors, where there are any."""
    missing = any(
        run["finite"] and channel["max_error_settled"] is None
        for run in runs
        for channel in run["channels"].values()
    )
    return [UNSETTLED] if missing else []


def outcome(run: dict[str, Any]) -> str:
    """Outcome of a run, in words."""
    roll = run["max_roll_rad"]
    turned = "unknown" if roll is None else f"{roll:.2f} rad"
    words = [f"{run['end_time_s']:.1f} s"]
    if run["waypoints_reached"] is not None:
        words.append(f"{run['waypoints_reached']} waypoints reached")
    words.append(f"max roll {turned}")
    if "status" in run:
        words.append(run["status"])
    if run.get("failure"):
        words.append(f"FAILED at {run['failure']['time_s']:.6g} s")
    elif not run["finite"]:
        words.append("FAILED: not finite")
    elif run["capsized"]:
        words.append("ROLLED OVER" if roll and roll > 3.15 else "rolled past 90 deg")
    return ", ".join(words)


def markdown_tables(runs: list[dict[str, Any]]) -> str:
    """All runs, beside the paper's printed tables where they have them."""
    parts = ["# Control performance\n"]
    if any(_is_printed(run) for run in runs):
        parts += [CAVEAT, ""]
    for scenario, plant in dict.fromkeys((r["scenario"], r["plant"]) for r in runs):
        group = [r for r in runs if (r["scenario"], r["plant"]) == (scenario, plant)]
        parts += [f"\n## {_flown(group[0])}\n", *_markdown_group(group), ""]
        parts += [f"- {r['controller']}: {outcome(r)}" for r in group]
        parts += [f"- {text}" for text in _explained(group)]
    return "\n".join(parts) + "\n"


def _markdown_group(group: list[dict[str, Any]]) -> list[str]:
    titles = []
    for run in group:
        if _is_printed(run):
            titles.append(f"{run['controller']} paper")
        titles.append(f"{run['controller']} here")
    rows = [
        "| channel | measure | " + " | ".join(titles) + " |",
        "|---|---|" + "---:|" * len(titles),
    ]
    for channel in CHANNEL_UNITS:
        for row, (key, title) in {**_PAPER_ROWS, **_OWN_ROWS}.items():
            cells = []
            for run in group:
                if _is_printed(run):
                    cells.append(figure(_printed(run, channel, row)))
                cells.append(figure(run["channels"][channel][key]))
            unit = f" [{unit_of(channel, key)}]"
            of = channel if row.startswith("time") else channel + unit
            rows.append(f"| {of} | {title} | " + " | ".join(cells) + " |")
    return rows


def _is_printed(run: dict[str, Any]) -> bool:
    """Whether the paper has a column for a run: not for a mission of the same name."""
    return run["published_case"] and run["controller"] in paper.CONTROLLERS


def _printed(run: dict[str, Any], channel: str, row: str) -> float | None:
    if row in _OWN_ROWS or not _is_printed(run):
        return None
    return paper.printed_value(run["scenario"], channel, run["controller"], row)


def figure(value: float | None) -> str:
    """A number in a table; a dash for none."""
    if value is None:
        return "-"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4f}"
    return f"{value:.2e}"


def decimals(value: float | None, digits: int, factor: float = 1.0) -> str:
    """A number with some decimals; a dash for none, or for one that is not finite.

    Args:
        value: number in SI units.
        digits: number of decimals.
        factor: size of the SI unit in that of the table.
    """
    if value is None or not math.isfinite(value):
        return "-"
    # Adding zero to what is rounded leaves no minus before it.
    return f"{round(factor * value, digits) + 0.0:.{digits}f}"


def text_columns(
    head: Sequence[str], rows: Sequence[Sequence[str]], left: int
) -> list[str]:
    """A table for a terminal, as wide as its titles.

    Args:
        head: titles of the columns.
        rows: cells, one sequence a row.
        left: width of the first column, which alone is aligned to the left.
    """
    widths = [len(title) + 2 for title in head[1:]]
    return [
        f"{first:<{left}}"
        + "".join(f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))
        for first, *cells in (head, *rows)
    ]


def markdown_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], left: int
) -> list[str]:
    """A Markdown table, its first columns to the left.

    Args:
        head: titles of the columns.
        rows: cells, one sequence a row.
        left: number of columns that are aligned to the left.
    """
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    lines = ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]
    return [*lines, ""]
