"""One tuned number: where it is, and how it is kept in its set."""

import dataclasses

from tuning.space.bijections import Bijection
from tuning.space.edges import Edge


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One tuned number.

    Attributes:
        path: dotted path from the closed loop.
        bijection: bijection between the number and its free number.
        edge: edge of its set.
        partners: paths of the numbers that its edge depends on, if any.
        followers: paths of numbers that are set to the same value.
    """

    path: str
    bijection: Bijection
    edge: Edge
    partners: tuple[str, ...] = ()
    followers: tuple[str, ...] = ()
