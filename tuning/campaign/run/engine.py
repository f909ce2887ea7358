"""The rollouts of a campaign, in pieces of equal size that run on one device each.

Every piece goes through one and the same program, compiled for one device, whatever the
number of devices: spread by a sharded program instead, the last bits of a member would
depend on how many there are. A piece that is not full is filled up with copies. So a
member's row is the same bit for bit alone, in any chunk and on any shard, on processors
of one kind.
"""

import concurrent.futures
import functools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxglider.core.batching import BLOCK, map_members
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.uncertainty.members import Member, with_member
from tuning.campaign.run.rows import flatten
from tuning.reporting.witness import Witness, assess

PIECE = 256
"""Members in a piece: on a CPU 256 to 1024 are equally fast, 64 a tenth slower."""
PIECE_ON_ACCELERATOR = 4096


class Engine:
    """Closed loops, compiled for every device."""

    def __init__(
        self,
        loops: Sequence[ClosedLoop],
        example: Member,
        devices: Sequence[jax.Device] | None = None,
        piece: int | None = None,
        members: int | None = None,
    ) -> None:
        """Compile the loops, side by side; those of one kind are one program.

        Args:
            loops: closed loops, one for each set of gains.
            example: an ensemble of at least one member.
            devices: devices to use; all of this process by default.
            piece: members to a piece; what suits the devices by default.
            members: number of members to come; devices that so few do not reach are
                compiled for when more come. By default all devices.
        """
        self._devices = list(devices or jax.local_devices())
        on_cpu = self._devices[0].platform == "cpu"
        self.piece = piece or (PIECE if on_cpu else PIECE_ON_ACCELERATOR)
        self._block = BLOCK if on_cpu else self.piece
        self._loops = [jax.device_put(list(loops), device) for device in self._devices]
        self._kinds = [_kind(loop) for loop in loops]
        self._programs: dict[tuple[int, Any], Any] = {}
        self._compile(self.width if members is None else members, example)

    @property
    def width(self) -> int:
        """Members that keep every device busy once."""
        return self.piece * len(self._devices)

    def run(self, members: Member) -> np.ndarray:
        """Results of members: axes of member, set of gains and column.

        Args:
            members: an ensemble of any size.
        """
        members = jax.tree.map(np.asarray, members)
        count = len(members.key)
        self._compile(count, members)
        pending = []
        for number, start in enumerate(range(0, count, self.piece)):
            device = number % len(self._devices)
            size = min(self.piece, count - start)
            part = jax.device_put(
                _filled(members, start, size, self.piece), self._devices[device]
            )
            pending.append(
                [
                    self._programs[device, kind](loop, part)
                    for kind, loop in zip(self._kinds, self._loops[device], strict=True)
                ]
            )
        done = [
            np.stack([flatten(*jax.device_get(found)) for found in piece], axis=1)
            for piece in pending
        ]
        return np.concatenate(done)[:count]

    def _compile(self, count: int, example: Member) -> None:
        """Compile what is missing for the devices that some members reach."""
        reached = min(-(-count // self.piece), len(self._devices))
        numbers = {kind: number for number, kind in enumerate(self._kinds)}
        missing = [
            (device, kind)
            for kind in numbers
            for device in range(reached)
            if (device, kind) not in self._programs
        ]
        if not missing:
            return
        filled = _filled(example, 0, 1, self.piece)

        def compiled(pair: tuple[int, Any]) -> Any:
            device, kind = pair
            members = jax.device_put(filled, self._devices[device])
            loop = self._loops[device][numbers[kind]]
            return _outcomes.lower(loop, members, self._block).compile()

        with concurrent.futures.ThreadPoolExecutor(len(self._devices)) as pool:
            found = pool.map(compiled, missing)
            self._programs |= dict(zip(missing, found, strict=True))


def _kind(loop: ClosedLoop) -> Any:
    """Kind of loop that a program serves: structure with all that is static, types."""
    types = tuple(jax.typeof(x) for x in jax.tree.leaves(loop))
    return jax.tree.structure(loop), types


# Traced once for all campaigns of loops and pieces of one kind.
@functools.partial(jax.jit, static_argnums=2)
def _outcomes(loop: ClosedLoop, members: Member, block: int) -> tuple[Metrics, Witness]:
    return map_members(
        lambda member: assess(*with_member(loop, member)), members, block=block
    )


def _filled(members: Member, start: int, size: int, piece: int) -> Member:
    """A stretch of members, filled up with copies of its last one."""
    chosen = np.minimum(np.arange(start, start + piece), start + size - 1)
    return jax.tree.map(lambda x: np.asarray(x)[chosen], members)
