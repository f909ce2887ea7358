"""The figures of a campaign, one function each: takes axes, returns axes."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxglider.plotting.lines import plain_numbers
from jaxglider.plotting.series import continuous_degrees
from jaxglider.plotting.style import (
    FAINT,
    INK,
    SHADE,
    flat,
    label_time,
    legend_above,
    styles,
)
from jaxglider.signals import CHANNELS
from tuning.campaign.analysis.bisection import Threshold
from tuning.campaign.analysis.ribbons import Ribbons
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.run.rows import Rows
from tuning.reporting.statistics import clopper_pearson

_SHOWN = {"depth": ("m", 1.0), "pitch": ("deg", 180.0 / np.pi)}
_SHOWN["heading"] = _SHOWN["pitch"]
_POINTS = 60


def draw_ribbons(axes: Any, ribbons: Ribbons, colour: str) -> Any:
    """The range of 90 % of the members' errors, their median, and the worst member.

    Args:
        axes: three axes, for depth, pitch and heading.
        ribbons: errors over time.
        colour: colour of the ribbon.
    """
    panels = flat(axes, 3, "draw_ribbons")
    for axis, channel in zip(panels, CHANNELS, strict=True):
        unit, scale = _SHOWN[channel]
        errors, worst = ribbons.errors[channel], ribbons.worst[channel]
        if channel == "heading":
            # The range of a member that turns round would jump by a whole turn.
            errors, worst = (_continuous(x) for x in (errors, worst))
        known = np.any(np.isfinite(errors), axis=0)
        time = ribbons.time[known]
        low, middle, high = scale * np.nanquantile(
            errors[:, known], [0.05, 0.5, 0.95], axis=0
        )
        axis.fill_between(time, low, high, color=colour, alpha=0.3, lw=0.0)
        axis.plot(time, middle, color=colour)
        axis.plot(ribbons.time, scale * worst, color=INK, lw=0.7, ls="--")
        for edge in ribbons.edges[channel]:
            axis.plot(ribbons.time, scale * edge, color=FAINT, lw=0.8, ls=":")
        _within(axis, scale, ribbons, channel)
        axis.set_ylabel(f"{channel} error ({unit})")
    label_time(panels, float(ribbons.time[-1]))
    legend_above(
        panels[0],
        [
            Line2D([], [], color=colour, alpha=0.3, lw=5.0, label="5–95 %"),
            Line2D([], [], color=colour, label="median"),
            Line2D([], [], color=INK, lw=0.7, ls="--", label="worst member"),
            Line2D([], [], color=FAINT, lw=0.8, ls=":", label="funnel"),
        ],
    )
    return axes


def _continuous(angle: np.ndarray) -> np.ndarray:
    """Angles [rad] over the last axis without jumps of whole turns."""
    return np.radians(np.apply_along_axis(continuous_degrees, -1, angle))


def _within(axis: Axes, scale: float, ribbons: Ribbons, channel: str) -> None:
    """Look at three times the widest funnel at most."""
    widest = scale * max(np.nanmax(np.abs(edge)) for edge in ribbons.edges[channel])
    sizes = np.concatenate([ribbons.worst[channel], ribbons.errors[channel].ravel()])
    sizes = scale * np.abs(sizes[np.isfinite(sizes)])
    largest = max(float(sizes.max()) if sizes.size else 0.0, widest)
    reach = min(1.08 * largest, 3.0 * widest)
    axis.set_ylim(-reach, reach)
    if largest > reach:
        axis.set_title(f"up to {largest:.3g}", loc="right", pad=3.0)


def convergence(axis: Axes, table: Rows) -> Axes:
    """The probability of leaving a funnel from the first n members, with interval."""
    counts = np.unique(np.geomspace(1, len(table), _POINTS).astype(int))
    for number, (label, style) in enumerate(styles(table.labels).items()):
        left = np.cumsum(table.left_funnel(number))[counts - 1]
        ends = [
            clopper_pearson(int(k), int(n)) for k, n in zip(left, counts, strict=True)
        ]
        low, high = np.transpose(ends)
        axis.fill_between(counts, low, high, color=style.colour, alpha=0.25, lw=0.0)
        axis.plot(
            counts, left / counts, color=style.colour, ls=style.dashes, label=label
        )
    axis.set_xscale("log")
    axis.set(xlabel="members", ylabel="P(left a specified funnel)", ylim=(-0.02, 1.02))
    axis.set_xlim(1, max(len(table), 2))
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return axis


def distributions(axes: Any, table: Rows) -> Any:
    """Distributions of the members' errors, one curve a set of gains.

    Args:
        axes: three axes, for depth, pitch and heading.
        table: rows of the campaign.
    """
    panels = flat(axes, 3, "distributions")
    for axis, channel in zip(panels, CHANNELS, strict=True):
        unit, scale = _SHOWN[channel]
        for number, (label, style) in enumerate(styles(table.labels).items()):
            values = np.sort(scale * table.column(number, f"{channel}.rms_error"))
            # A few members far off would squeeze all others together.
            values = np.where(values <= _far(table, channel, scale), values, np.inf)
            share = np.arange(1, len(values) + 1) / len(values)
            known = np.isfinite(values)
            axis.step(
                values[known],
                share[known],
                where="post",
                color=style.colour,
                ls=style.dashes,
                label=label,
            )
        axis.set_xlim(0.0, None)
        axis.set_xlabel(f"{channel} rms error ({unit})")
        axis.set_ylim(0.0, 1.0)
    panels[0].set_ylabel("share of members below")
    handles = panels[-1].get_legend_handles_labels()[0]
    legend_above(panels[-1], handles)
    return axes


def _far(table: Rows, channel: str, scale: float) -> float:
    """Beyond what 98 % of the members come to, with the worst set of gains."""
    ends = [
        np.sort(table.column(number, f"{channel}.rms_error"))[
            int(0.98 * (len(table) - 1))
        ]
        for number in range(len(table.labels))
    ]
    return scale * max(ends)


def scatter(
    axis: Axes, values: np.ndarray, name: str, severity: np.ndarray, colour: str
) -> Axes:
    """The severity of each member against one uncertain number.

    Args:
        axis: axes to draw on.
        values: values of the number.
        name: name of the number, with its unit.
        severity: largest error over the edge of its funnel; infinite for failures.
        colour: colour of the points.
    """
    known = np.isfinite(severity)
    # A few dots are to be seen, thousands to be told apart.
    size = np.clip(1500.0 / max(len(severity), 1), 3.0, 15.0)
    axis.scatter(values[known], severity[known], size, color=colour, alpha=0.5, lw=0.0)
    if np.any(~known):
        top = np.full(np.sum(~known), axis.get_ylim()[1])
        axis.plot(values[~known], top, "x", color=INK, ms=4.0, label="not finite")
        legend_above(axis, axis.get_legend_handles_labels()[0])
    axis.axhline(1.0, color=FAINT, lw=0.8, ls=":")
    axis.set_yscale("log")
    axis.set(xlabel=name, ylabel="largest error over its funnel")
    plain_numbers(axis.yaxis)
    return axis


def bars(
    axis: Axes,
    names: Sequence[str],
    groups: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]],
    colours: Sequence[str],
) -> Axes:
    """Horizontal bars with intervals, the first name on top.

    Args:
        axis: axes to draw on.
        names: names of the rows.
        groups: values, lower ends and upper ends by label, each with one number a row.
        colours: colours of the groups.
    """
    wide = 0.8 / len(groups)
    rows = np.arange(len(names))
    pairs = zip(groups.items(), colours, strict=True)
    for place, ((label, (value, low, high)), colour) in enumerate(pairs):
        at = rows + wide * (place - (len(groups) - 1) / 2)
        axis.barh(at, value, wide, color=colour, label=label)
        ends = np.stack([value - low, high - value])
        axis.errorbar(
            value, at, xerr=np.maximum(ends, 0.0), fmt="none", ecolor=INK, lw=0.7
        )
    axis.set_yticks(rows, names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.axvline(0.0, color=INK, lw=0.6)
    return axis


def levels(axis: Axes, summaries: Sequence[CampaignSummary]) -> Axes:
    """The probability of leaving a funnel against how much is uncertain."""
    widths = [100.0 * float(summary.uncertainty) for summary in summaries]
    for label, style in styles(summaries[0].controllers).items():
        entries = [
            summary.controllers[label].probabilities["p_violation"]
            for summary in summaries
        ]
        p = np.asarray([entry["p"] for entry in entries])
        ends = np.asarray([entry["interval"] for entry in entries])
        axis.errorbar(
            widths,
            p,
            yerr=np.maximum([p - ends[:, 0], ends[:, 1] - p], 0.0),
            color=style.colour,
            ls=style.dashes,
            marker="o",
            ms=3.0,
            label=label,
        )
    axis.set(
        xlabel="half width of the uncertainty (%)", ylabel="P(left a specified funnel)"
    )
    axis.set_ylim(-0.02, 1.02)
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return axis


def specification(
    axis: Axes, summaries: Sequence[CampaignSummary], threshold: Threshold | None
) -> Axes:
    """The probability of breaking the specification against how much is uncertain.

    Args:
        axis: axes to draw on.
        summaries: summaries of the levels, in their order.
        threshold: bracket of the level at which it stops to hold, shaded.
    """
    widths = [100.0 * float(summary.uncertainty) for summary in summaries]
    for label, style in styles(summaries[0].controllers).items():
        entries = [of.controllers[label].broken["any"] for of in summaries]
        ends = np.asarray([entry["simultaneous"] for entry in entries])
        axis.fill_between(
            widths, ends[:, 0], ends[:, 1], color=style.colour, alpha=0.2, lw=0.0
        )
        p = [entry["p"] for entry in entries]
        axis.plot(
            widths,
            p,
            color=style.colour,
            ls=style.dashes,
            marker="o",
            ms=3,
            label=label,
        )
    limits = {rule["limit"] for rule in summaries[0].requirements if "limit" in rule}
    for limit in limits:
        axis.axhline(limit, color=INK, lw=0.8, ls="--", label="required")
    if threshold is not None and None not in (threshold.holds_at, threshold.fails_at):
        low, high = (100.0 * float(x or 0) for x in dataclasses.astuple(threshold))
        axis.axvspan(low, high, color=SHADE, lw=0.0, zorder=0, label="stops to hold")
    axis.set_xlabel("half width of the uncertainty (%)")
    axis.set_ylabel("P(breaks the specification)")
    axis.set_ylim(-0.02, 1.02)
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return axis
