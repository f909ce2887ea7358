"""The loop of a campaign: draw, run, append, until all is done or enough is known."""

from collections.abc import Callable

import numpy as np

from jaxglider.uncertainty.members import Member
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.rows import Rows, make_rows
from tuning.campaign.run.store import Store
from tuning.problem.members import keys_of
from tuning.reporting.statistics import clopper_pearson

STEP = 512
"""Members after which `--until-ci` looks, on any number of devices."""


def draw(campaign: Campaign, first: int, count: int) -> tuple[np.ndarray, Member]:
    """Values and ensemble of members `first` to `first + count`.

    Args:
        campaign: campaign they belong to.
        first: number of the first one.
        count: number of members.
    """
    values = campaign.uncertainty.values(campaign.design.rows(first, count))
    numbers = campaign.design.key_numbers(first, count)
    keys = keys_of(campaign.settings.seed, campaign.stream, numbers)
    return values, campaign.uncertainty.members(values, keys)


def compute(campaign: Campaign, engine: Engine, first: int, count: int) -> np.ndarray:
    """Rows of members `first` to `first + count`.

    Args:
        campaign: campaign they belong to.
        engine: engine that runs them.
        first: number of the first member.
        count: number of members.
    """
    values, members = draw(campaign, first, count)
    return make_rows(first, values, engine.run(members))


def run_campaign(
    campaign: Campaign,
    engine: Callable[[], Engine],
    store: Store,
    first: int,
    last: int,
    progress: Callable[[int], None],
) -> None:
    """Fill a store with the rows of members `first` to `last`.

    Args:
        campaign: campaign to run.
        engine: maker of the engine; not called where nothing is left to do.
        store: store, which may hold rows already.
        first: number of its first member.
        last: number after its last one.
        progress: callback with the number of rows after each chunk.

    Raises:
        OSError: the rows cannot be written.
    """
    at = first + store.count
    if at >= last or enough(campaign, store):
        return
    running = engine()
    chunk = STEP * -(-running.width // STEP)
    while at < last:
        # Chunks end where one that was never interrupted ends.
        stop = min(last, first + chunk * ((at - first) // chunk + 1))
        rows = compute(campaign, running, at, stop - at)
        while len(rows):
            count = min(len(rows), STEP - store.count % STEP)
            store.append(rows[:count])
            rows = rows[count:]
            if enough(campaign, store):
                return
        at = stop
        progress(store.count)


def continues(campaign: Campaign, engine: Engine, store: Store, first: int) -> bool:
    """Whether the last row of a store comes out the same again, bit for bit.

    Args:
        campaign: campaign of the store.
        engine: engine that runs the member.
        store: store with one row at least.
        first: number of the store's first member.
    """
    last = compute(campaign, engine, first + store.count - 1, 1)
    return last.tobytes() == store.rows()[-1:].tobytes()


def enough(campaign: Campaign, store: Store) -> bool:
    """Whether every interval of leaving a funnel is as narrow as asked for."""
    wanted = campaign.settings.until_ci
    if wanted is None or store.count == 0 or store.count % STEP:
        return False
    table = Rows(store.rows(), campaign.labels)
    for number in range(len(campaign.labels)):
        left = int(np.sum(table.left_funnel(number)))
        low, high = clopper_pearson(left, len(table))
        if high - low > wanted:
            return False
    return True
