"""Results as tables for a terminal and as Markdown."""

from typing import Any

from jaxglider import paper

CAVEAT = (
    "The printed values are shown as they stand in the paper. Its transient values are "
    "partly below its own root mean square of the same error, its heading efforts lie "
    "above the actuator's limit of pi/2 and its SMC heading errors above pi: its units "
    "or windows are not those it defines, so read the columns side by side with care."
)
_PAPER_ROWS = {
    "transient": ("max_error", "max abs(e)"),
    "average_tracking": ("rms_error", "L2[e]"),
    "average_effort": ("rms_effort", "L2[U]"),
    "chattering": ("chattering", "L2[dU]"),
}
_COLUMNS = {
    "max_error": "max|e|",
    "max_error_settled": "settled",
    "rms_error": "L2[e]",
    "rms_effort": "L2[U]",
    "chattering": "chatter",
    "time_outside_funnel": "outside",
}
_UNITS = {"depth": "m", "pitch": "rad", "heading": "rad"}


def text_table(runs: list[dict[str, Any]]) -> str:
    """Runs of one scenario and plant as text for a terminal."""
    first = runs[0]
    wide = max(10, *(len(r["controller"]) for r in runs)) + 2
    head = "".join(f"{title:>10}" for title in _COLUMNS.values())
    lines = [
        f"{first['scenario']} on {first['plant']}",
        f"{'channel':<14}{'controller':<{wide}}{head}{'paper L2[e]':>13}",
    ]
    for channel, unit in _UNITS.items():
        for run in runs:
            measures = run["channels"][channel]
            cells = "".join(f"{_figure(measures[k]):>10}" for k in _COLUMNS)
            printed = paper.printed_value(
                run["scenario"], channel, run["controller"], "average_tracking"
            )
            lines.append(
                f"{f'{channel} [{unit}]':<14}{run['controller']:<{wide}}{cells}"
                f"{_figure(printed):>13}"
            )
    lines += [f"{r['controller']:>{wide}}: {outcome(r)}" for r in runs]
    return "\n".join(lines)


def outcome(run: dict[str, Any]) -> str:
    """How a run ended, in words."""
    roll = run["max_roll_rad"]
    turned = "unknown" if roll is None else f"{roll:.2f} rad"
    words = [f"{run['end_time_s']:.1f} s"]
    if run["waypoints_reached"] is not None:
        words.append(f"{run['waypoints_reached']} waypoints reached")
    words.append(f"max roll {turned}")
    if not run["finite"]:
        words.append("FAILED: not finite")
    elif run["capsized"]:
        words.append("ROLLED OVER" if roll and roll > 3.15 else "rolled past 90 deg")
    return ", ".join(words)


def markdown_tables(runs: list[dict[str, Any]]) -> str:
    """All runs beside the paper's printed tables."""
    parts = ["# Control performance\n", CAVEAT, ""]
    for scenario, plant in dict.fromkeys((r["scenario"], r["plant"]) for r in runs):
        group = [r for r in runs if (r["scenario"], r["plant"]) == (scenario, plant)]
        parts += [f"\n## {scenario} on {plant}\n", *_markdown_group(group), ""]
        parts += [f"- {r['controller']}: {outcome(r)}" for r in group]
    return "\n".join(parts) + "\n"


def _markdown_group(group: list[dict[str, Any]]) -> list[str]:
    names = [run["controller"] for run in group]
    titles = [f"{n} paper | {n} here" for n in names]
    rows = [
        "| channel | measure | " + " | ".join(titles) + " |",
        "|---|---|" + "---:|---:|" * len(names),
    ]
    for channel, unit in _UNITS.items():
        for row, (key, title) in _PAPER_ROWS.items():
            cells = []
            for run in group:
                printed = paper.printed_value(
                    run["scenario"], channel, run["controller"], row
                )
                here = run["channels"][channel][key]
                cells.append(f"{_figure(printed)} | {_figure(here)}")
            rows.append(f"| {channel} [{unit}] | {title} | " + " | ".join(cells) + " |")
        for key in ("max_error_settled", "time_outside_funnel", "time_saturated"):
            cells = [f" | {_figure(run['channels'][channel][key])}" for run in group]
            title = key.replace("_", " ")
            rows.append(f"| {channel} | {title} | " + " | ".join(cells) + " |")
    return rows


def _figure(value: float | None) -> str:
    if value is None:
        return "-"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4f}"
    return f"{value:.2e}"
