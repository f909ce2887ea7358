"""Sections of the report of tuning, from plain numbers."""

from typing import Any

from jaxglider.signals import CHANNEL_UNITS
from tuning.reporting.ledger import markdown_ledger
from tuning.reporting.tables import markdown_table

_LEDGER = (
    "The law keeps what it promises where these hold. Counted are the held-out members "
    "in which each held, with the exact 95 % interval of how likely that is."
)


def ledger_section(ledgers: dict[str, Any]) -> list[str]:
    """The ledger of assumptions before and after."""
    lines = ["\n## Assumptions of the theorem\n", _LEDGER]
    for name, entries in ledgers.items():
        lines += [f"\n{name.capitalize()}:\n", *markdown_ledger(entries)]
    return lines


def robust_section(robustness: dict[str, Any] | None) -> list[str]:
    """Lines on other ticks and roundings; none where they were not asked for."""
    if robustness is None:
        return []
    rows = [
        [
            f"{channel} [{unit}]",
            _cell(at["nominal"][channel]),
            _cell(at["held_out"][channel]),
            tick,
        ]
        for channel, unit in CHANNEL_UNITS.items()
        for tick, at in robustness["ticks"].items()
    ]
    for channel, unit in CHANNEL_UNITS.items():
        spans = [
            robustness["roundings"][part][channel] for part in ("nominal", "held_out")
        ]
        cells = ["-" if x is None else f"{x[0]:.4g} to {x[1]:.4g}" for x in spans]
        rows.append([f"{channel} [{unit}]", *cells, "roundings"])
    head = ["rms error", "nominal", "held out, mean", "tick [s]"]
    return ["\n## At other ticks, and over roundings\n", *markdown_table(head, rows, 1)]


def specified_section(counts: dict[str, Any]) -> list[str]:
    """Numbers of members that broke each part of what is specified."""
    parts = list(counts["after"]["broken"])
    rows = [
        [name, *(f"{of['broken'][part]} of {of['members']}" for part in parts)]
        for name, of in counts.items()
    ]
    table = markdown_table(["members that broke", *parts], rows, 1)
    return ["\n## The specification\n", *table]


_SEARCHED = (
    "Severity is the largest error over its specified edge, or the roll over the bank "
    "limit: above 1 the specification is broken. Each search begins anew with the "
    "gains reached; the last is on the tuned gains, and what it found joined nothing."
)


def adversarial_section(about: dict[str, Any] | None) -> list[str]:
    """Searches for the worst members between descents; none without rounds."""
    if about is None:
        return []
    rows = [
        [
            f"after step {one['step']}",
            _severity(one["severity"]),
            one["found_by"],
            _severity(one["known"]) if number else "-",
        ]
        for number, one in enumerate(about["searches"])
    ]
    head = ["search", "worst found", "by", "worst of those found before"]
    return [
        "\n## Worst members\n",
        f"{about['joined']} members that {about['rollouts_of_a_search']} rollouts each "
        f"search found worst joined training and validation. {_SEARCHED}\n",
        *markdown_table(head, rows, 1),
    ]


def adversarial_line(about: dict[str, Any] | None) -> list[str]:
    """The worst member before and after the rounds, in one line for a terminal."""
    if about is None:
        return []
    first, last = (_severity(about["searches"][at]["worst"]) for at in (0, -1))
    return [
        f"worst member found: severity {first} after the first descent, {last} in the "
        f"end; {about['joined']} found members joined"
    ]


def _severity(value: float | None) -> str:
    return "not finite" if value is None else f"{value:.4g}"


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
