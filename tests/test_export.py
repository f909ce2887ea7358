"""The exported C code does what the traced function does, tick by tick."""

import compiled_c
import jax
import numpy as np
import pytest
from compiled_c import Onboard, columns

from jaxglider import paper
from jaxglider.autopilot import autopilot
from jaxglider.export.c_code import autopilot_source
from jaxglider.export.vectors import broken, fly, replay, sea
from jaxglider.guard import Guard, status_names

needs_compiler = pytest.mark.skipif(
    compiled_c.COMPILER is None, reason="no C compiler on this machine"
)
TICKS = 16_000
FUZZED = 17_000
"""For each of six exports: 102,000 in all."""


@pytest.fixture(scope="module", params=["switching", "waypoints"])
def course(request):
    """A case of the paper, and 800 s of what its sensors say."""
    loop = paper.make_loop(request.param, "printed", "fxtppc")
    return request.param, loop, fly(autopilot(loop), loop, sea(loop, TICKS, hold=20))


def _limits(loop):
    actuators = loop.scenario.actuators
    return np.array([float(a.limit) for a in vars(actuators).values()])


@needs_compiler
@pytest.mark.parametrize("name", paper.CONTROLLERS)
def test_compiled_code_follows_the_trace_even_through_faults(course, name, tmp_path):
    scenario, given, seen = course
    loop = paper.make_loop(scenario, "printed", name)
    pilot = autopilot(loop, Guard(patience=0.5))
    times = np.arange(TICKS + FUZZED) * 0.05
    rows = jax.tree.map(
        lambda x: np.concatenate([x, np.asarray(x)[:1000].repeat(17)]), seen.measured
    )
    late, bad = broken(times[TICKS:], jax.tree.map(lambda x: x[TICKS:], rows), seed=1)
    times[TICKS:] = late
    rows = jax.tree.map(lambda x, b: np.concatenate([x[:TICKS], b]), rows, bad)
    expected = columns(replay(pilot, times, rows))
    source = autopilot_source(pilot, "test")
    double = Onboard(tmp_path / "double", source).replay(times, rows)
    limits = _limits(given)
    off = np.abs(double - expected)[:, :3] / limits
    assert off.max() < 1e-10
    np.testing.assert_array_equal(double[:, 3], expected[:, 3])
    words = {name for w in expected[TICKS:, 3] for name in status_names(int(w))}
    assert {"measurement_lost", "clock_stuck", "clock_backwards"} <= words
    assert {"clock_invalid", "clock_disbelieved", "state_reset"} <= words
    for commands in (double, expected):
        assert np.isfinite(commands).all()
        assert (np.abs(commands[:, :3]) <= limits * (1 + 1e-15)).all()
