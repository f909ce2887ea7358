"""Headings in dives and climbs with the gains that come along.

`python benchmarks/bench_climb.py` dives for 2000 s at 26° and 0.1 m/s of depth rate,
climbs for 400 s on the same heading and for 800 s on one that is 40° off, in calm water
and again in a current of 0.1 m/s across, with the vehicle's actuators. It prints how
far each law is off its heading at the end of each phase, its largest roll, and the
growth of the slowest motion of the linearised loop on dive and climb. Run it in the
folder above.
"""

import dataclasses
import math
import sys
from typing import Any

import jax
import numpy as np

from jaxglider import Calm, Current, Water, paper, simulate
from jaxglider.files.gains import load_gains
from jaxglider.guidance import AttitudeSchedule, Schedule
from jaxglider.paper.tuned import tuned_gains
from jaxglider.simulation.checks.stability import Glide, loop_modes
from jaxglider.simulation.scenario import Scenario
from tuning.cli.session.jax_setup import start_jax

ANGLE, RATE = math.radians(26.0), 0.1
PHASES = (2000.0, 2400.0, 3200.0)
"""Ends of the phases [s]."""
LAWS, PLANTS = ("fxtppc", "ppc", "smc", "pid"), ("rigid-body", "seawing")


def main() -> int:
    start_jax(64)
    run = jax.jit(lambda loop, sea: simulate(loop, sea, keep_every=20))
    rows = [
        "| law | plant | water | dive | climb | turn | roll | growth, dive | climb |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for plant in PLANTS:
        for law in LAWS:
            for current in (0.0, 0.1):
                scenario = _task(plant, current)
                gains = tuned_gains("switching", plant, law)
                model = paper.design_model(scenario.plant)
                loop = load_gains(gains, "switching", model).on(scenario)
                ticks = run(loop, scenario.sea(jax.random.key(0))).ticks
                glides = (Glide(-ANGLE, RATE), Glide(ANGLE, -RATE))
                dive, climb = (m.growth for m in loop_modes(loop, glides))
                rows.append(_row(law, plant, current, ticks, (dive, climb)))
                sys.stderr.write(rows[-1] + "\n")
    sys.stdout.write("\n".join(rows) + "\n")
    return 0


def _task(plant: str, current: float) -> Scenario:
    scenario = paper.make_scenario("switching", plant, duration=PHASES[-1])
    schedule = Schedule(
        start=[0.0, *PHASES[:-1]],
        gliding_angle=[-ANGLE, ANGLE, ANGLE],
        heading=[0.0, 0.0, math.radians(40.0)],
        depth_rate=[RATE, -RATE, -RATE],
    )
    water = Water(current=Current(east=current)) if current else None
    start = dataclasses.replace(scenario.initial_state, sway=current)
    return dataclasses.replace(
        scenario,
        reference=AttitudeSchedule(schedule),
        disturbance=Calm(),
        water=water,
        initial_state=start,
    )


def _row(
    law: str, plant: str, current: float, ticks: Any, growth: tuple[float, float]
) -> str:
    time = np.asarray(ticks.time)
    error = np.degrees(np.asarray(ticks.error.heading))
    ends = [error[np.searchsorted(time, end) - 1] for end in PHASES]
    roll = np.degrees(np.abs(np.asarray(ticks.state.roll)).max())
    cells = [law, plant, f"{current:g} m/s" if current else "calm"]
    cells += [f"{end:+.2f}°" for end in ends] + [f"{roll:.0f}°"]
    cells += [f"{rate:+.4f}" for rate in growth]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    sys.exit(main())
