"""A campaign whose runs cost nothing and are known, for tests of all around them."""

import numpy as np

from tuning.campaign.run.loop import STEP
from tuning.campaign.run.rows import COLUMNS

RUN = "sweep --no-report --precision 64 --plant printed --duration 2 --controller smc "
"""The command of a short campaign, but for members and folder."""


class Toy:
    """An engine whose runs are known: a share leaves the funnel, some fail."""

    width = STEP
    log: tuple = ()

    def __init__(self, loops, example, members):
        self._gains = len(loops)

    def run(self, members):
        # By bits that depend on the member alone.
        bits = np.asarray(members.key)[:, 0].astype(np.int64)
        found = np.full((len(bits), self._gains, len(COLUMNS)), 0.5)
        found[:, :, COLUMNS.index("finite")] = 1.0
        found[:, :, COLUMNS.index("capsized")] = 0.0
        for name in ("depth", "pitch", "heading"):
            found[:, :, COLUMNS.index(f"{name}.time_outside_funnel")] = 0.0
        found[bits % 4 == 0, :, COLUMNS.index("depth.time_outside_funnel")] = 0.1
        found[bits % 100 == 1] = np.nan
        for name, flag in (("finite", 0.0), ("capsized", 1.0)):
            found[bits % 100 == 1, :, COLUMNS.index(name)] = flag
        found[:, :, COLUMNS.index("pitch.rms_error")] += (bits % 997)[:, None]
        for gains in range(1, self._gains):
            found[:, gains, COLUMNS.index("pitch.rms_error")] -= 0.25
        return found
