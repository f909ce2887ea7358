"""A campaign on several hosts: each runs its part, the first one gathers the rows.

The hosts need no common disk: rows travel through JAX. Each host keeps its own part in
a folder of its own, so that what was killed goes on with `--resume` on every host.
"""

import argparse
import itertools
from collections.abc import Iterator

import numpy as np

_AT_ONCE = 4096


def join_hosts(options: argparse.Namespace) -> None:
    """Meet the other hosts; must come before the first computation.

    Args:
        options: `coordinator`, `hosts` and `host` of the command line.

    Raises:
        ValueError: they do not go together.
    """
    several = [options.coordinator is not None, options.hosts > 1]
    if several == [False, False] and options.host == 0:
        return
    if several != [True, True] or options.host >= options.hosts:
        raise ValueError(
            "--coordinator ADDRESS:PORT, --hosts N and --host I go together, with "
            f"N > 1 and 0 <= I < N; received {options.coordinator}, {options.hosts} "
            f"and {options.host}."
        )
    import jax

    jax.distributed.initialize(options.coordinator, options.hosts, options.host)


def parts(total: int, hosts: int) -> list[tuple[int, int]]:
    """First member, and the number after the last one, of each part."""
    ends = [total * i // hosts for i in range(hosts + 1)]
    return list(itertools.pairwise(ends))


def gathered(
    rows: np.ndarray, total: int, host: int, hosts: int
) -> Iterator[np.ndarray]:
    """The rows of all hosts in the order of the members, on every host.

    Args:
        rows: rows of this host.
        total: members of the campaign.
        host: number of this one.
        hosts: number of hosts.
    """
    from jax.experimental import multihost_utils

    for source, (first, last) in enumerate(parts(total, hosts)):
        for start in range(first, last, _AT_ONCE):
            count = min(_AT_ONCE, last - start)
            part = np.zeros(count, rows.dtype)
            if source == host:
                part = np.array(rows[start - first : start - first + count])
            sent = multihost_utils.broadcast_one_to_all(
                np.frombuffer(part.tobytes(), np.uint8), is_source=source == host
            )
            yield np.frombuffer(np.asarray(sent).tobytes(), rows.dtype)
