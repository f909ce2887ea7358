"""Manoeuvres to learn the rest by: a section of the report, lines for a terminal."""

from collections.abc import Mapping
from typing import Any

from tuning.identification.information.manoeuvres import Advice, best_of
from tuning.reporting.tables import markdown_table


def flights_section(content: Mapping[str, Any]) -> list[str]:
    """The manoeuvre that would narrow each interval most, as Markdown.

    Args:
        content: numbers and sentences of a fit.
    """
    rows = []
    for one in content["parameters"]:
        best = best_of(_advices(content), one["name"])
        if best is not None:
            manoeuvre, share, same = best
            after = f"{share * one['deviation']:.2g}"
            again = f"{same * one['deviation']:.2g}"
            rows.append(
                [one["name"], f"{one['deviation']:.2g}", again, after, manoeuvre]
            )
    if not rows:
        return []
    head = ["number", "± now", "± by the same again", "± at best", "by flying"]
    return [
        "## What to fly to learn more",
        "",
        "The standard deviation of each number after one more flight as long as those "
        "fitted, by the Fisher information of the fitted glider: the same dives once "
        "more, and the manoeuvre that narrows it most.",
        "",
        *markdown_table(head, rows, 1),
    ]


def flights_text(content: Mapping[str, Any]) -> list[str]:
    """Manoeuvres by which to learn the numbers that the record does not tell.

    Args:
        content: numbers and sentences of a fit.
    """
    lines = []
    for one in content["parameters"]:
        best = best_of(_advices(content), one["name"])
        if best is None or one["identified"]:
            continue
        manoeuvre, share, same = best
        told = f"would narrow its interval to {share:.0%}"
        if share > 0.8:
            told = (
                f"would narrow it most, and only to {share:.0%}: measure it otherwise"
            )
        elif share < 0.9 * same:
            told += f" ({same:.0%} by the same again)"
        lines.append(f"to learn {one['name']}: {manoeuvre} {told}.")
    return lines


def _advices(content: Mapping[str, Any]) -> list[Advice]:
    return [Advice(**one) for one in content["next_flights"]]
