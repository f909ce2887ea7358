"""Several levels of uncertainty side by side: how likely is trouble at each."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from jaxglider.files.writing import write_json, write_text
from jaxglider.plotting.save import save
from jaxglider.plotting.style import COLUMN, look, new_figure
from tuning.campaign.analysis.bisection import Threshold
from tuning.campaign.analysis.rank_correlations import SEVERITY
from tuning.campaign.analysis.summary import CampaignSummary, ControllerSummary
from tuning.campaign.report import figures
from tuning.campaign.report.text import in_interval
from tuning.reporting.html import write_html
from tuning.reporting.output_folder import LOCK
from tuning.reporting.tables import markdown_table

_WRITTEN = (
    "",
    ".",
    "..",
    "summary.json",
    "report.md",
    "report.html",
    "levels.png",
    "specification.png",
    LOCK,
)
"""Names in use in the folder that holds those of the levels."""
_EVENTS = {
    "p_violation": "left a specified funnel",
    "p_capsize": "rolled past 90 deg",
    "p_failure": "not finite",
}


def folder_names(levels: Sequence[float | Path]) -> dict[float | Path, str]:
    """Names of the folders that the results of several levels are written to.

    A file has its own name; where that is in use, its folders go before it.

    Raises:
        ValueError: two levels would be written to one folder.
    """
    names = {
        level: level.stem if isinstance(level, Path) else f"uncertainty-{level!r}"
        for level in levels
    }
    used = [*_WRITTEN, *map(str.casefold, names.values())]
    for level, name in names.items():
        if isinstance(level, Path) and used.count(name.casefold()) > 1:
            parts = level.with_suffix("").parts
            names[level] = "-".join(p for p in parts if p not in (".", "..", "/"))
    used = [*_WRITTEN, *map(str.casefold, names.values())]
    for level, name in names.items():
        if used.count(name.casefold()) > 1:
            raise ValueError(
                f"--uncertainty {level}: its results would be written to {name!r}, "
                "which another level or the report of all has. Rename the file."
            )
    return names


def write_levels(
    folder: Path,
    summaries: dict[str, CampaignSummary],
    draws: bool,
    threshold: Threshold | None = None,
) -> None:
    """Write summary.json and report.md of all levels.

    Args:
        folder: folder that holds the folders of the levels.
        summaries: summaries by the names of the levels' own folders.
        draws: flag, the report is written and drawn besides summary.json.
        threshold: bracket of the level at which the specification stops to hold.
    """
    table: dict[str, Any] = {"levels": named(summaries)}
    if threshold is not None:
        table["specification"] = dataclasses.asdict(threshold)
    write_json(folder / "summary.json", table)
    if not draws:
        return
    ordered = list(summaries.values())
    parts = [
        f"# How sure: {ordered[0].headline}\n",
        f"{ordered[0].members} members at each level, with the same draws, only "
        f"wider. Brackets are {100 * ordered[0].confidence:g} % intervals.\n",
    ]
    if all(isinstance(summary.uncertainty, float) for summary in ordered):
        for name, figure in level_figures(ordered, threshold):
            save(figure, folder / f"{name}.png")
        parts.append("![levels](levels.png)\n")
        parts += _specified(ordered, threshold)
    labels = list(ordered[0].controllers)
    for event, title in _EVENTS.items():
        rows = [
            [f"[{name}]({name}/report.md)"]
            + [
                in_interval(summary.controllers[label].probabilities[event])
                for label in labels
            ]
            for name, summary in summaries.items()
        ]
        parts += [f"## {title.capitalize()}\n", *markdown_table(["", *labels], rows, 1)]
    rows = [
        [name, label, ", ".join(_strongest(summary.controllers[label]))]
        for name, summary in summaries.items()
        for label in labels
    ]
    parts.append("## What drives it\n")
    parts.append(
        "Rank correlation of what was drawn with the largest error over the edge of "
        "its funnel, strongest first.\n"
    )
    parts += markdown_table(["", "gains", "with"], rows, 3)
    text = "\n".join(parts) + "\n"
    write_text(folder / "report.md", text)
    write_html(folder / "report.html", text, ordered[0].provenance)


def level_figures(
    summaries: Sequence[CampaignSummary], threshold: Threshold | None
) -> Iterator[tuple[str, Figure]]:
    """Name and figure of what grows with the uncertainty.

    Args:
        summaries: summaries of the levels, in their order.
        threshold: bracket of the level at which the specification stops to hold.
    """
    title = summaries[0].headline
    with look():
        figure = new_figure(COLUMN, 2.8)
        figures.levels(figure.subplots(), summaries)
        figure.suptitle(title, wrap=True)
    yield "levels", figure
    with look():
        figure = new_figure(COLUMN, 2.8)
        figures.specification(figure.subplots(), summaries, threshold)
        figure.suptitle(title, wrap=True)
    yield "specification", figure


def _specified(
    summaries: Sequence[CampaignSummary], threshold: Threshold | None
) -> list[str]:
    """Lines on the whole specification at each level."""
    count = max(len(of.broken) for of in summaries[0].controllers.values())
    lines = ["## The whole specification\n"]
    if threshold is not None:
        lines.append(f"It {threshold.text()}, with the same draws at each level.\n")
    lines.append(
        f"Intervals of its parts and of any of them hold at once, {count} in all, by "
        "Bonferroni's correction.\n"
    )
    return [*lines, "![specification](specification.png)\n"]


def named(summaries: dict[str, CampaignSummary]) -> list[dict[str, Any]]:
    """Summaries of the levels, each with the name of its folder."""
    return [{"level": name, **summary.to_dict()} for name, summary in summaries.items()]


def _strongest(controller: ControllerSummary) -> list[str]:
    ranked = controller.rank_correlations[SEVERITY][:4]
    return [f"{entry['quantity']} {entry['rho']:+.2f}" for entry in ranked]
