"""One attitude, one command: full turns in an angle change nothing."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.onboard.guard import status_names
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import GliderState
from jaxglider.simulation.rollout import simulate

TURNS = {
    "as it is": {},
    "roll": {"roll": 1},
    "roll back": {"roll": -1},
    "pitch": {"pitch": 1},
    "heading": {"heading": -1},
    "all": {"roll": -2, "pitch": -1, "heading": 3},
}
TILTED = {"roll": 0.4, "pitch": -0.3, "heading": 0.2, "surge": 0.2}


def turned(state):
    """The same attitude written in several ways, one row each."""
    angles = {
        name: jnp.asarray(
            [getattr(state, name) + 2 * np.pi * t.get(name, 0) for t in TURNS.values()]
        )
        for name in ("roll", "pitch", "heading")
    }
    rows = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(TURNS),)), state)
    return dataclasses.replace(rows, **angles)


@pytest.mark.parametrize(
    ("law", "scenario", "plant"),
    [
        ("fxtppc", "switching", "printed"),
        ("fxtppc-roll", "waypoints", "rigid-body"),
        ("ppc", "switching", "rigid-body"),
        ("smc", "waypoints", "seawing"),
    ],
)
def test_a_start_with_full_turns_gives_the_same_run(law, scenario, plant):
    loop = paper.make_loop(scenario, plant, law, duration=15.0)
    sea = loop.scenario.sea(jax.random.key(0))

    def run(start):
        setting = dataclasses.replace(loop.scenario, initial_state=start)
        return simulate(dataclasses.replace(loop, scenario=setting), sea)

    flown = jax.jit(jax.vmap(run))(turned(GliderState.at_rest(east=3.0, **TILTED)))
    found = jax.tree.map(np.asarray, flown)
    ticks = found.ticks
    for name, signal in {
        "metrics": found.metrics,
        "commands": ticks.wanted,
        "errors": ticks.error,
        "estimate": ticks.estimate,
        "roll": ticks.state.roll,
        "pitch": ticks.state.pitch,
        "heading": (np.sin(ticks.state.heading), np.cos(ticks.state.heading)),
    }.items():
        for leaf in jax.tree.leaves(signal):
            for row, how in zip(leaf, TURNS, strict=True):
                np.testing.assert_allclose(
                    row, leaf[0], rtol=1e-6, atol=1e-8, err_msg=f"{name}, {how}"
                )
    assert np.all((found.metrics.max_roll >= 0.4) & (found.metrics.max_roll < np.pi))


def test_on_board_an_angle_may_jump_by_full_turns_between_ticks():
    """As that of a compass or of an inertial unit does."""
    loop = paper.make_loop("waypoints", "rigid-body", "fxtppc-roll", duration=10.0)
    pilot = autopilot(loop)
    flight = jax.jit(simulate)(loop, loop.scenario.sea(jax.random.key(0)))
    rows = jax.tree.map(lambda x: x[:100], flight.ticks.state)
    jumping = np.random.default_rng(0).integers(-2, 3, (3, 100)) * 2 * np.pi
    changed = dataclasses.replace(
        rows,
        **{
            name: getattr(rows, name) + jump
            for name, jump in zip(("roll", "pitch", "heading"), jumping, strict=True)
        },
    )

    @jax.jit
    def on_board(rows):
        def tick(state, given):
            time, measured = given
            after, *said = pilot.step(state, time, measured, pilot.plan(state, time))
            return after, said

        return jax.lax.scan(tick, pilot.init(), (0.05 * jnp.arange(100.0), rows))[1]

    (steady, _), (commands, words) = on_board(rows), on_board(changed)
    for found, wanted in zip(
        jax.tree.leaves(commands), jax.tree.leaves(steady), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9)
    assert {s for w in np.unique(words) for s in status_names(int(w))} <= {
        "saturated",
        "state_reset",
    }
