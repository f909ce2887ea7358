"""How well heading could be steered: `python docs/heading_bound.py`, for heading.md.

The paper's switching case on `rigid-body`, nominal glider and sea: FxTPPC, and the same
law made aware of the roll, both with gains tuned for actuators that jump, and with such
actuators. To the mass angle that
the first asks for, an angle planned beforehand is added, one number every two seconds
of the first two minutes after each new heading. These numbers are found by gradient
descent through the rollout: what perfect knowledge of glider and sea could do, with no
law to obey. Nothing is planned for the end of a segment, so that the plan cannot turn
before it is told to. It writes images/heading_bound.png.

`--actuators vehicle` does the same for the gains that come along, on actuators as fast
as the vehicle's file says, with a plan that keeps the roll within 45°; with `--plant
seawing` on the other plant, with `--law smc` beside another law. It writes no picture.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import jaxglider
from jaxglider import ClosedLoop, Command, evaluate, paper, simulate
from jaxglider.control import AbstractController
from jaxglider.files.gains import load_gains
from jaxglider.files.user_law import label_of
from jaxglider.paper.tuned import tuned_gains
from jaxglider.plotting.save import save
from jaxglider.plotting.style import (
    PAGE,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import Trajectory

SEGMENT, PLANNED, EVERY = 200.0, 120.0, 2.0
"""Length of a segment, of its planned beginning, and between two planned angles [s]."""
MEMORY = 100.0
"""How long the gradient remembers [s]."""
DEPTH_AND_PITCH = (0.0199, 0.0314)
"""L2[e] that the other channels may come to [m, rad]."""
UPRIGHT, FREE, SPECIFIED = 1.5, 10.0, 0.785
"""Largest rolls of the plans [rad]."""


class Planned(AbstractController):
    """A law whose mass angle has a planned one added.

    Attributes:
        law: what is added to.
        angles: the plan of the whole run [rad], one number each `EVERY` seconds.
    """

    law: AbstractController
    angles: jax.Array

    def init(self) -> Any:
        """The law's state, and the time [s]."""
        return self.law.init(), jnp.zeros_like(self.angles[0])

    def step(
        self, state: Any, measurement: Any, reference: Any, bounds: Any, dt: Any
    ) -> Any:
        """The law's command with the planned angle added."""
        inner, time = state
        wanted, inner, record = self.law.step(inner, measurement, reference, bounds, dt)
        place = time / EVERY
        before = jnp.floor(place)
        number = before.astype(jnp.int32)
        ahead = jnp.minimum(number + 1, self.angles.shape[0] - 1)
        share = place - before
        angle = (1.0 - share) * self.angles[number] + share * self.angles[ahead]
        angle = jnp.where(time % SEGMENT < PLANNED, angle, 0.0)
        steered = Command(
            wanted.buoyancy_mass, wanted.mass_position, wanted.mass_angle + angle
        )
        return steered, (inner, time + dt), record

    @property
    def model(self) -> Any:
        """The law's design model."""
        return self.law.model

    @property
    def funnel(self) -> Any:
        """The law's funnel."""
        return self.law.funnel


def excess(value: jax.Array, limit: float) -> jax.Array:
    """By how much of it a limit is exceeded."""
    return jnp.maximum(value / limit - 1.0, 0.0)


def cost(metrics: Metrics, roll: float, limits: tuple[float, float]) -> jax.Array:
    """Heading error [rad], and what keeps the rest within its limits."""
    c = metrics.channels
    depth, pitch = limits
    others = excess(c.depth.rms_error, depth) + excess(c.pitch.rms_error, pitch)
    return c.heading.rms_error + others + excess(metrics.max_roll, roll) ** 2


def tuned(kind: str) -> ClosedLoop:
    """A law with the gains tuned for actuators that jump."""
    scenario = paper.make_scenario("switching", "rigid-body", actuators="ideal")
    model = paper.design_model(scenario.plant)
    file = Path(__file__).parent / "ideal" / f"rigid-body-{kind}.toml"
    return load_gains(file, "switching", model).on(scenario)


def shipped(plant: str, law: str) -> ClosedLoop:
    """A law with the gains that come along, on actuators that have a speed."""
    scenario = paper.make_scenario("switching", plant)
    model = paper.design_model(scenario.plant)
    gains = tuned_gains("switching", plant, law)
    return load_gains(gains, "switching", model).on(scenario)


def best_plan(
    loop: ClosedLoop,
    roll: float,
    steps: int,
    limits: tuple[float, float] = DEPTH_AND_PITCH,
) -> ClosedLoop:
    """The loop with the best plan that Adam finds."""
    sea = loop.scenario.sea(jax.random.key(0))
    law = loop.controller

    def planned(angles: jax.Array) -> ClosedLoop:
        return eqx.tree_at(lambda at: at.controller, loop, Planned(law, angles))

    @jax.jit
    @jax.value_and_grad
    def value(angles: jax.Array) -> jax.Array:
        return cost(
            evaluate(planned(angles), sea, gradient_memory=MEMORY), roll, limits
        )

    clock = loop.scenario.clock
    angles = jnp.zeros(round(clock.ticks * float(clock.dt) / EVERY) + 1)
    adam = optax.chain(
        optax.clip_by_global_norm(1.0),
        optax.adam(optax.cosine_decay_schedule(0.02, steps)),
    )
    state = adam.init(angles)
    best = (float("inf"), angles)
    for step in range(steps):
        now, slope = value(angles)
        if float(now) < best[0]:
            best = float(now), angles
        change, state = adam.update(slope, state)
        angles = optax.apply_updates(angles, change)
        if step % 50 == 0:
            sys.stderr.write(f"roll < {roll:g}: step {step}, best {best[0]:.4f}\n")
    return planned(best[1])


def row(name: str, trajectory: Trajectory) -> str:
    """Errors and largest roll of a run."""
    metrics = trajectory.metrics
    errors = [
        f"{float(getattr(metrics.channels, channel).rms_error):.3g}"
        for channel in ("depth", "pitch", "heading")
    ]
    return "| " + " | ".join([name, *errors, f"{float(metrics.max_roll):.2f}"]) + " |"


def draw(runs: dict[str, Trajectory], dt: float, path: Path) -> None:
    """Heading, mass angle and roll of all runs; one tick is dt [s]."""
    rows: dict[str, Callable[[Any], Any]] = {
        "heading (deg)": lambda at: at.state.heading,
        "mass angle (deg)": lambda at: at.applied.mass_angle,
        "roll (deg)": lambda at: at.state.roll,
    }
    with look():
        figure = new_figure(PAGE, 5.0)
        axes = figure.subplots(len(rows), 1, sharex=True)
        for axis, (label, of) in zip(axes, rows.items(), strict=True):
            for style, (name, run) in zip(
                distinct_styles(len(runs)), runs.items(), strict=True
            ):
                angle = np.degrees(np.asarray(of(run.ticks)))
                time = dt * np.arange(angle.size)
                line = {"color": style.colour, "ls": style.dashes, "label": name}
                axis.plot(time, angle, **line)
            axis.set_ylabel(label)
        axes[-1].set_xlabel("time (s)")
        legend_above(axes[0], axes[0].get_legend_handles_labels()[0])
        save(figure, path)


def main() -> None:
    """Plan, print a table and, for actuators that jump, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--actuators", choices=("ideal", "vehicle"), default="ideal")
    parser.add_argument("--plant", choices=("rigid-body", "seawing"))
    parser.add_argument("--law", choices=("fxtppc", "ppc", "smc", "pid"))
    picture = Path(__file__).parent / "images" / "heading_bound.png"
    parser.add_argument("--out", type=Path, default=picture)
    options = parser.parse_args()
    if (options.plant or options.law) and options.actuators == "ideal":
        parser.error("--plant and --law go with --actuators vehicle")
    jaxglider.enable_fast_loops()
    jax.config.update("jax_enable_x64", True)
    run = jax.jit(simulate)
    if options.actuators == "vehicle":
        law = options.law or "fxtppc"
        loop = shipped(options.plant or "rigid-body", law)
        sea = loop.scenario.sea(jax.random.key(0))
        flown = run(loop, sea)
        own = flown.metrics.channels
        limits = float(own.depth.rms_error), float(own.pitch.rms_error)
        plan = best_plan(loop, SPECIFIED, options.steps, limits)
        runs = {label_of(law): flown, "with a plan, within 45°": run(plan, sea)}
    else:
        loop = tuned("fxtppc")
        sea = loop.scenario.sea(jax.random.key(0))
        loops = {
            "FxTPPC": loop,
            "FxTPPC-roll": tuned(paper.ROLL_AWARE),
            "planned, upright": best_plan(loop, UPRIGHT, options.steps),
            "planned, free to roll": best_plan(loop, FREE, options.steps),
        }
        runs = {name: run(one, sea) for name, one in loops.items()}
        draw(runs, float(loop.scenario.clock.dt), options.out)
    print("| | depth [m] | pitch [rad] | heading [rad] | largest roll [rad] |")
    print("|---|---:|---:|---:|---:|")
    for name, trajectory in runs.items():
        print(row(name, trajectory))


if __name__ == "__main__":
    main()
