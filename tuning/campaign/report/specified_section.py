"""The section of a campaign's report on specification and assumptions."""

from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report.text import in_interval
from tuning.reporting.ledger import TITLES
from tuning.reporting.tables import markdown_table

_LEDGER = (
    "The law keeps what it promises where all of these hold. Each number is how likely "
    "a member is in which it does, seen in the runs themselves.\n"
)


def specified_section(summary: CampaignSummary) -> list[str]:
    """Lines on how likely each part of the specification is broken, and the ledger.

    Args:
        summary: summary of the campaign.
    """
    controllers = summary.controllers
    parts = dict.fromkeys(name for of in controllers.values() for name in of.broken)
    lines = ["## The specification\n", "How likely a member breaks it:\n"]
    rows = [
        [
            "any part" if part == "any" else part,
            *(in_interval(of.broken[part]) for of in controllers.values()),
        ]
        for part in parts
    ]
    lines += markdown_table(["", *controllers], rows, 1)
    rows = [
        [
            title,
            *(
                in_interval(of.ledger[name]["holds"]) if name in of.ledger else "-"
                for of in controllers.values()
            ),
        ]
        for name, title in TITLES.items()
        if any(name in of.ledger for of in controllers.values())
    ]
    lines += ["## Assumptions of the theorem\n", _LEDGER]
    return [*lines, *markdown_table(["holds", *controllers], rows, 1)]
