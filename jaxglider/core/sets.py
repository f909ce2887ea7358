"""The sets that numbers must be in, as they stand beside a field's unit.

`eqx.field(metadata={"unit": "s", "set": Interval(0.0, 1.0)})` says what the field may
be. Construction refuses numbers outside, and a search over the field's numbers stays
inside: a law of one's own has its search space from its fields alone. The set of a
field that holds a container is that of each number in it. A field without a set is
not checked, and is searched as a positive number; `"tuned": False` leaves one out.
"""

import dataclasses
import math
from typing import Any

K1_BELOW_K2 = "k1-below-k2-squared"
OBSERVER_SET = "observer-set"
SECH_ABOVE_BOUND = "sech-above-final-bound"
RULES = (K1_BELOW_K2, OBSERVER_SET, SECH_ABOVE_BOUND)
"""Names of the rules that couple two numbers."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """All numbers between two ends; positive where nothing else is said.

    Attributes:
        low: lower end.
        high: upper end.
        closed_low: whether the lower end belongs to it.
        closed_high: whether the upper end belongs to it.
    """

    low: float = 0.0
    high: float = math.inf
    closed_low: bool = False
    closed_high: bool = False

    def holds(self, number: Any) -> Any:
        """Whether a number is inside; of an array, which of its numbers are."""
        above = number >= self.low if self.closed_low else number > self.low
        below = number <= self.high if self.closed_high else number < self.high
        return above & below

    def words(self) -> str:
        """The set in words, as after "must be"."""
        if math.isinf(self.high):
            if self.low == 0.0:
                return "zero or positive" if self.closed_low else "positive"
            return f"{'at least' if self.closed_low else 'above'} {self.low:g}"
        if math.isinf(self.low):
            return f"{'at most' if self.closed_high else 'below'} {self.high:g}"
        opening = "[" if self.closed_low else "("
        closing = "]" if self.closed_high else ")"
        return f"in {opening}{self.low:g}, {self.high:g}{closing}"


@dataclasses.dataclass(frozen=True)
class Coupled:
    """Two positive numbers, fields of one object, that a rule of the theory couples.

    Both fields carry it. Number by number where the fields hold containers.

    Attributes:
        rule: name of the rule, one of `RULES`.
        first: name of the one field: k₁, ι₁ or P₀.
        second: name of the other: k₂, ι₂ or P_∞.

    Raises:
        ValueError: an unknown rule.
    """

    rule: str
    first: str
    second: str

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise ValueError(
                f"Coupled.rule must be one of {', '.join(RULES)}; "
                f"received {self.rule!r}."
            )


NumberSet = Interval | Coupled

POSITIVE = Interval()
NOT_NEGATIVE = Interval(closed_low=True)
UNIT = Interval(0.0, 1.0)
UNIT_CLOSED = Interval(0.0, 1.0, closed_high=True)
SHARE = Interval(0.0, 1.0, closed_low=True, closed_high=True)
ABOVE_ONE = Interval(1.0)
FROM_ONE = Interval(1.0, closed_low=True)
