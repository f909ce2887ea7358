"""The level of uncertainty at which something stops to hold, by bisection."""

import dataclasses
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class Threshold:
    """Bracket of the level at which something stops to hold.

    Attributes:
        holds_at: largest level tried at which it holds; None where it holds nowhere.
        fails_at: smallest level tried at which it does not; None where it holds
            everywhere.
    """

    holds_at: float | None
    fails_at: float | None

    def text(self) -> str:
        """The bracket in words, levels in per cent."""
        if self.fails_at is None:
            return f"holds up to the {100 * (self.holds_at or 0):g} % asked for"
        if self.holds_at is None:
            return f"does not hold at {100 * self.fails_at:g} %, the least tried"
        return (
            f"holds at {100 * self.holds_at:g} % and no more at "
            f"{100 * self.fails_at:g} %"
        )


def find_threshold(
    holds: Callable[[float], bool], highest: float, resolution: float
) -> Threshold:
    """Bisect for the level at which something stops to hold.

    It is taken to hold below where it holds, and not to hold above where it does not:
    with the same draws at each level, only wider, a member that breaks a rule mostly
    goes on to break it. At most 2 + log₂(highest/resolution) levels are tried.

    Args:
        holds: whether it holds at a level; called once for each level tried.
        highest: highest level to try.
        resolution: width of the bracket at which to stop, and least level tried.
    """
    if holds(highest):
        return Threshold(highest, None)
    low, high = min(resolution, highest), highest
    if low == high or not holds(low):
        return Threshold(None, low)
    while high - low > resolution * (1.0 + 1e-9):
        middle = round(0.5 * (low + high), 6)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return Threshold(low, high)
