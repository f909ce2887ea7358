"""Sensitivity to the uncertain numbers three ways: Sobol, ranks, derivatives.

The runs for Sobol indices go through the campaign's own engine and are kept beside its
rows, in `sobol.bin`: killed, they go on where they were.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tuning.campaign.analysis.derivatives import gradient_scores
from tuning.campaign.analysis.rank_correlations import OUTPUTS, output
from tuning.campaign.analysis.sobol import Saltelli, indices
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.loop import run_campaign
from tuning.campaign.run.rows import Rows
from tuning.campaign.run.store import Store
from tuning.problem.members import SENSITIVITY

CHANCE = "chance"
"""Name of what is left to chance within a run, as a factor."""
_LEADING, _BEHIND = 5, 10


def design_of(campaign: Campaign, blocks: int) -> Saltelli:
    """The design of the runs for Sobol indices."""
    uncertainty = campaign.uncertainty
    return Saltelli(
        seed=campaign.settings.seed,
        columns=len(uncertainty.quantities),
        bases=blocks,
        chance=uncertainty.has_chance(),
    )


def run_blocks(
    campaign: Campaign,
    blocks: int,
    engine: Callable[[], Engine],
    path: Path,
    kind: np.dtype,
    progress: Callable[[int, int], None],
) -> Rows:
    """Run what is not yet run of the blocks, and return their rows.

    Args:
        campaign: campaign whose members they are like.
        blocks: number of blocks.
        engine: maker of the engine.
        path: path of the file that keeps the rows.
        kind: type of the rows.
        progress: callback with the numbers of runs done and of all runs.

    Raises:
        OSError: the rows cannot be written.
    """
    design = design_of(campaign, blocks)
    total = blocks * design.block
    like = dataclasses.replace(
        campaign,
        settings=dataclasses.replace(campaign.settings, until_ci=None),
        design=design,
        stream=SENSITIVITY,
    )
    store = Store(path, kind, 0)
    try:
        run_campaign(like, engine, store, 0, total, lambda n: progress(n, total))
        return Rows(np.array(store.rows()[:total]), campaign.labels)
    finally:
        store.close()


def sensitivities(
    campaign: Campaign,
    blocks: int,
    table: Rows,
    runs: Rows,
    correlations: Sequence[dict[str, Any]],
) -> list[dict[str, Any] | None]:
    """Uncertain numbers that each set of gains answers to, by output.

    Args:
        campaign: campaign they are about.
        blocks: number of blocks of the runs for Sobol indices.
        table: rows of the campaign.
        runs: rows of the blocks.
        correlations: rank correlations of each set of gains.
    """
    design = design_of(campaign, blocks)
    names = [*campaign.uncertainty.names(), *([CHANCE] if design.chance else [])]
    answers: list[dict[str, Any] | None] = []
    for number, ranked in enumerate(correlations):
        scores = gradient_scores(campaign, number, len(table))
        answers.append(
            {
                name: _one(
                    names,
                    indices(output(runs, number, name).reshape(blocks, design.block)),
                    ranked[name],
                    scores.get(name),
                )
                for name in OUTPUTS
            }
        )
    return answers


def _one(
    names: list[str],
    sobol: dict[str, Any],
    ranked: list[dict[str, Any]],
    slopes: np.ndarray | None,
) -> dict[str, Any]:
    """One output: a row for each factor, the largest total index first."""
    rho = {entry["quantity"]: entry["rho"] for entry in ranked}
    rows = []
    for place, name in enumerate(names):
        row: dict[str, Any] = {"quantity": name, "rho": rho.get(name)}
        for index in ("first", "total"):
            if sobol[index] is not None:
                value, low, high = (float(x) for x in sobol[index][:, place])
                row[index], row[f"{index}_interval"] = value, [low, high]
        if slopes is not None and place < len(slopes) and np.isfinite(slopes[place]):
            row["gradient"] = float(slopes[place])
        rows.append(row)
    rows.sort(key=lambda row: -row.get("total", abs(row["rho"] or 0.0)))
    return {
        "blocks": sobol["blocks"],
        "blocks_left_out": sobol["left_out"],
        "rows": rows,
        **agreement(rows),
    }


def agreement(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Agreement of the ways on the order of the factors, and their disagreements.

    Args:
        rows: scores of the factors; those are compared that all ways know of.

    Returns:
        `agreement`, Spearman's correlation of the scores of each two ways, and
        `disagreements`: factors among the first five one way and beyond the tenth
        another way, in words.
    """
    from scipy import stats  # a second to import, and seldom needed

    ways = {
        "total index": [row.get("total") for row in rows],
        "rank correlation": [
            None if (r := row["rho"]) is None else abs(r) for row in rows
        ],
        "gradient": [row.get("gradient") for row in rows],
    }
    known = [
        all(scores[i] is not None for scores in ways.values() if any(scores))
        for i in range(len(rows))
    ]
    complete = {
        way: np.array([s for s, k in zip(scores, known, strict=True) if k], float)
        for way, scores in ways.items()
        if any(scores)
    }
    listed = [row["quantity"] for row, k in zip(rows, known, strict=True) if k]
    places = {
        way: stats.rankdata(-scores, "ordinal") for way, scores in complete.items()
    }
    correlations: dict[str, float] = {}
    apart = []
    for one in complete:
        for other in complete:
            if one < other and len(listed) > 2:
                pair = f"{one} / {other}"
                correlations[pair] = float(
                    stats.spearmanr(complete[one], complete[other]).statistic
                )
            for name, here, there in zip(
                listed, places[one], places[other], strict=True
            ):
                if here <= _LEADING and there > _BEHIND:
                    apart.append(
                        f"{name} is number {int(here)} by {one}, "
                        f"{int(there)} by {other}"
                    )
    return {"agreement": correlations, "disagreements": apart}
