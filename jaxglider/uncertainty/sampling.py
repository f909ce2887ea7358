"""Designs: where the members of an ensemble lie in the unit cube.

A design gives coordinates u in (0, 1), one row a member, one column an uncertain
quantity. Any stretch of rows can be asked for alone, in any order, on any host.

| design | member i depends on |
|---|---|
| `MonteCarlo` | seed, i; each column on its own name alone |
| `SobolSequence` | seed, i, and how many columns there are |
| `LatinHypercube` | seed, i, how many columns and how many members there are |

Independent draws are the only ones for which exact binomial intervals hold; the other
two fill the cube more evenly, so that these intervals are usually too wide for them.
"""

import dataclasses
import functools
import warnings
import zlib
from abc import abstractmethod

import numpy as np

_SMALLEST = 2.0**-54


class AbstractSampler:
    """Rows of coordinates in the unit cube."""

    @abstractmethod
    def rows(self, first: int, count: int) -> np.ndarray:
        """Coordinates in (0, 1) of members `first` to `first + count`."""

    def key_numbers(self, first: int, count: int) -> np.ndarray:
        """Numbers that the members' random keys are made of; their own by default."""
        return np.arange(first, first + count)


@dataclasses.dataclass(frozen=True)
class MonteCarlo(AbstractSampler):
    """Independent draws, each column from a counter-based stream of its own.

    Adding a quantity or changing the order moves no other one.

    Attributes:
        seed: seed in [0, 2³²).
        names: names of the columns.
        stream: sets of members with another stream share none, whatever the seed.
    """

    seed: int
    names: tuple[str, ...]
    stream: int = 0

    def rows(self, first: int, count: int) -> np.ndarray:
        """Column j: numbers `first` to `first + count` of its own stream."""
        columns = [self._column(name, first, count) for name in self.names]
        return np.stack(columns, axis=1) if columns else np.empty((count, 0))

    def _column(self, name: str, first: int, count: int) -> np.ndarray:
        key = [(self.stream << 32) + self.seed, zlib.crc32(name.encode())]
        # The generator makes four numbers at a time.
        bits = np.random.Philox(counter=first // 4, key=key)
        skipped = first % 4
        draws = np.random.Generator(bits).random(skipped + count)[skipped:]
        return np.maximum(draws, _SMALLEST)


@dataclasses.dataclass(frozen=True)
class SobolSequence(AbstractSampler):
    """The Sobol sequence, scrambled; best where the members are a power of two.

    Attributes:
        seed: seed of the scrambling.
        columns: number of columns.
    """

    seed: int
    columns: int

    def rows(self, first: int, count: int) -> np.ndarray:
        """Points `first` to `first + count` of the sequence."""
        from scipy.stats import qmc

        sequence = qmc.Sobol(self.columns, scramble=True, seed=self.seed)
        if first:
            sequence.fast_forward(first)
        with warnings.catch_warnings():
            # A stretch is a part of the whole: its own length says nothing.
            warnings.simplefilter("ignore", UserWarning)
            return np.maximum(sequence.random(count), _SMALLEST)


@dataclasses.dataclass(frozen=True)
class LatinHypercube(AbstractSampler):
    """One member in each of N equal slices of every coordinate.

    All N rows are made at once and kept: 8 bytes for each member and column.

    Attributes:
        seed: seed of the slices and of the places within them.
        columns: number of columns.
        members: N.
    """

    seed: int
    columns: int
    members: int

    def rows(self, first: int, count: int) -> np.ndarray:
        """Rows of the one table."""
        table = _latin_hypercube(self.seed, self.columns, self.members)
        return table[first : first + count]


@functools.lru_cache(maxsize=1)
def _latin_hypercube(seed: int, columns: int, members: int) -> np.ndarray:
    from scipy.stats import qmc

    table = qmc.LatinHypercube(columns, seed=seed).random(members)
    return np.maximum(table, _SMALLEST)
