"""Tables and figure of heading.md: `python docs/heading.py` writes heading.png."""

import argparse
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider import load_vehicle, paper
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.plotting.save import save
from jaxglider.plotting.style import (
    INK,
    PAGE,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from jaxglider.signals import BodyAxes, Command, GliderState, zeros
from jaxglider.trim.linear_model import STATES, linearise
from jaxglider.trim.modes import transmission_zeros, zero_dynamics
from jaxglider.trim.steady_motion import SteadyMotion, Target, steady_motion
from jaxglider.vehicle.plant import AbstractPlant

POINTS = {
    "-45 deg, 0.141 m/s": (-45.0, 0.1 * math.sqrt(2.0)),
    "-35 deg, 0.4 m/s": (-35.0, 0.4),
    "-26 deg, 0.228 m/s": (-26.0, 0.228),
    "26 deg, 0.228 m/s": (26.0, 0.228),
    "35 deg, 0.4 m/s": (35.0, 0.4),
}
"""The glide of the paper's first leg (depth rate 0.1 m/s), a usual one, and dives and
climbs to compare."""
STEP, TICK, SHOWN = math.radians(-5.0), 0.05, 60.0

trim = jax.jit(steady_motion)
slopes = jax.jit(linearise)


@jax.jit
def stepped(plant: AbstractPlant, motion: SteadyMotion) -> GliderState:
    """The glider over time after its moving mass has turned by `STEP`."""
    held = motion.command
    command = Command(held.buoyancy_mass, held.mass_position, held.mass_angle + STEP)

    def advance(state: GliderState, _: None) -> tuple[GliderState, GliderState]:
        def rate(at: GliderState, node: jax.Array) -> GliderState:
            return plant.derivative(at, command, zeros(BodyAxes))

        return runge_kutta_step(RK4, rate, state, jnp.asarray(TICK)), state

    return jax.lax.scan(advance, motion.state, None, length=int(SHOWN / TICK))[1]


def straight(plant: AbstractPlant, angle: float, speed: float) -> SteadyMotion:
    """A straight glide; angle in degrees."""
    wanted = Target(speed=speed, glide_angle=math.radians(angle), turn_rate=0.0)
    return trim(plant, wanted)


def row(name: str, plant: AbstractPlant, angle: float, speed: float) -> str:
    """What a radian of γ does at once and in the end, and the slowest zeros."""
    motion = straight(plant, angle, speed)
    a, b = (np.asarray(x) for x in slopes(plant, motion))
    inner = [STATES.index(n) for n in ("roll", "sway", "roll_rate", "yaw_rate")]
    end = -np.linalg.solve(a[np.ix_(inner, inner)], b[inner, 2])
    turn = a[STATES.index("heading"), inner] @ end
    slow = [z for z in transmission_zeros(a, b) if z.imag >= 0.0][:2]
    words = ", ".join(
        f"{z.real:.3f}" + (f" ± {z.imag:.3f}i" if z.imag else "") for z in slow
    )
    at_once = b[STATES.index("yaw_rate"), 2]
    return f"| {name} | {at_once:.3f} | {end[0]:+.2f} | {turn:.4f} | {words} |"


def draw(path: Path) -> None:
    """Four panels: heading and roll after a step, the zeros, and roll while held."""
    angle, speed = next(iter(POINTS.values()))
    time = np.arange(int(SHOWN / TICK)) * TICK
    vehicle = load_vehicle("seawing")
    with look():
        figure = new_figure(PAGE, 4.6)
        (heading, roll), (plane, held) = figure.subplots(2, 2)
        for (name, make), style in zip(
            paper.PLANTS.items(), distinct_styles(3), strict=True
        ):
            plant = make(vehicle)
            motion = straight(plant, angle, speed)
            line = {"color": style.colour, "ls": style.dashes, "label": name}
            after = stepped(plant, motion)
            heading.plot(time, np.degrees(after.heading), **line)
            roll.plot(time, np.degrees(after.roll), **line)
            a, b = (np.asarray(x) for x in slopes(plant, motion))
            found = transmission_zeros(a, b)
            plane.plot(found.real, found.imag, "o", ms=4, color=style.colour)
            start = np.zeros(len(STATES))
            start[STATES.index("roll")] = math.radians(10.0)
            quiet = zero_dynamics(a, b, start, time)
            held.plot(time, np.degrees(quiet[:, STATES.index("roll")]), **line)
        for axis, label in ((heading, "heading (deg)"), (roll, "roll (deg)")):
            axis.set_ylabel(label)
            axis.set_xlabel("time after −5° of γ (s)")
            axis.set_xlim(0.0, SHOWN)
        heading.set_ylim(-5.0, 95.0)
        plane.axvline(0.0, color=INK, lw=0.5)
        plane.set_xlabel("zeros: decay (1/s)")
        plane.set_ylabel("frequency (rad/s)")
        held.set_xlabel("time with the heading held (s)")
        held.set_ylabel("roll (deg)")
        held.set_xlim(0.0, SHOWN)
        legend_above(heading, heading.get_legend_handles_labels()[0])
    save(figure, path)


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    here = Path(__file__).parent
    parser.add_argument("--out", type=Path, default=here / "images" / "heading.png")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    vehicle = load_vehicle("seawing")
    for title, (angle, speed) in POINTS.items():
        print(f"\n{title}:\n")
        print("| plant | yaw at once | roll in the end | turn in the end | zeros |")
        print("|---|---:|---:|---:|---|")
        for name, make in paper.PLANTS.items():
            print(row(name, make(vehicle), angle, speed))
    draw(options.out)


if __name__ == "__main__":
    main()
