"""The specification and the assumptions of the theorem, from a campaign's rows."""

from typing import Any

import numpy as np

from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.rows import Rows, metrics_and_witness
from tuning.reporting.ledger import ledger, to_dict
from tuning.reporting.statistics import probability
from tuning.reporting.violations import broken


def specified_part(
    campaign: Campaign, table: Rows, number: int, level: float
) -> dict[str, Any]:
    """The fields `broken` and `ledger` of the summary of one set of gains.

    Args:
        campaign: campaign that the rows belong to.
        table: rows of the campaign.
        number: number of the set of gains.
        level: level of confidence of each interval by itself.
    """
    loop = campaign.loops[number]
    flags = table.violations(number, loop.scenario.specification)
    parts = {"any": broken(flags), **flags}
    metrics, witness = metrics_and_witness(np.array(table.rows["metrics"][:, number]))
    return {
        "broken": {name: probability(flag, level) for name, flag in parts.items()},
        "ledger": to_dict(ledger(loop, metrics, witness, level=level)),
    }
