"""Reckoning and current of the missions on sensors: how far they miss.

`python benchmarks/bench_reckoning.py` flies the Slocum and the Seaglider that come with
the package on their sensors alone, over some drawings of their noise: in still water,
and in the steady current of their files, which they do not know at first. It prints how
far the reckoning missed at the surfacings, over the way made since the fix before, and
how well the mean current of a leg was told. Run it in the folder above.
"""

import dataclasses
import sys
from typing import Any

import jax
import numpy as np

import jaxglider
from jaxglider.environment.water import Current
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import load_mission
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.cli.session.jax_setup import start_jax

MISSIONS = ("slocum-on-board", "seaglider-on-board")
SEEDS = 16


def still(loop: ClosedLoop) -> ClosedLoop:
    """The same mission in water that does not move."""
    scenario = loop.scenario
    assert scenario.water is not None
    water = dataclasses.replace(scenario.water, current=Current())
    return dataclasses.replace(
        loop, scenario=dataclasses.replace(scenario, water=water)
    )


@jax.jit
def known(loop: ClosedLoop, key: jax.Array) -> Any:
    """What was known on board of place and current."""
    scenario = loop.scenario
    return jaxglider.evaluate(loop, scenario.sea(key), scenario.noise(key)).navigation


def main() -> int:
    start_jax(64)
    rows = [
        "| mission | water | surfacings | missed by | of the way | current known to |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for name in MISSIONS:
        own = load_mission(mission_path(name)).loop
        for words, loop in (("still", still(own)), ("0.1 m/s", own)):
            found = [known(loop, jax.random.key(n)) for n in range(SEEDS)]
            mean = jax.tree.map(lambda *x: float(np.mean(x)), *found)
            rows.append(
                f"| {name} | {words} | {mean.surfacings:g} | {mean.miss:.0f} m "
                f"| {100.0 * mean.miss_share:.1f} % "
                f"| {100.0 * mean.current_error:.1f} cm/s |"
            )
            sys.stderr.write(rows[-1] + "\n")
    sys.stdout.write("\n".join(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
