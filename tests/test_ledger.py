"""The ledger of assumptions: right where each one is broken on purpose."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import Channels, Specification, paper
from jaxglider.control.fxtppc import reaching_law
from jaxglider.simulation.checks.law_rates import fastest_rate
from jaxglider.simulation.metrics import ChannelMetrics
from tuning.reporting.ledger import (
    TITLES,
    ledger,
    markdown_ledger,
    observer_set_holds,
    text_ledger,
    to_dict,
    with_smoothing,
)
from tuning.reporting.statistics import clopper_pearson
from tuning.reporting.violations import broken, violations
from tuning.reporting.witness import assess
from tuning.space.edges import in_observer_set

CHANNELS = ("depth", "pitch", "heading")
KEY = jax.random.key(0)


def changed(loop, where, value):
    """The loop with another number or numbers, as arrays of the same kind."""
    old = where(loop)
    new = jax.tree.map(lambda x: jnp.full_like(x, value), old)
    return eqx.tree_at(where, loop, new)


@pytest.fixture(scope="module")
def sound():
    """A short run in which every assumption holds."""
    loop = paper.make_loop("switching", "printed", "fxtppc", duration=20.0)
    schedule = loop.scenario.reference.schedule
    schedule = dataclasses.replace(schedule, start=jnp.asarray([0.0, 12.0, 14.0, 16.0]))
    specification = Specification(
        loop.scenario.specification.funnel, settling_time=Channels(8.0, 8.0, 8.0)
    )
    scenario = dataclasses.replace(
        loop.scenario,
        reference=dataclasses.replace(loop.scenario.reference, schedule=schedule),
        specification=specification,
    )
    loop = dataclasses.replace(loop, scenario=scenario)
    # Small turns, a weak law, a quick observer, and actuators that reach far.
    headings = lambda x: x.scenario.reference.schedule.heading
    loop = eqx.tree_at(headings, loop, jnp.asarray([0.1, 0.0, 0.1, 0.0]))
    angles = lambda x: x.scenario.reference.schedule.gliding_angle
    loop = eqx.tree_at(angles, loop, -0.7 - 0.1 * headings(loop))
    loop = changed(loop, lambda x: x.observer.integral, 40.0)
    loop = changed(loop, lambda x: x.observer.proportional, 4.0)
    for name in ("buoyancy_mass", "mass_position", "mass_angle"):
        at = lambda x, name=name: getattr(x.scenario.actuators, name).limit
        loop = changed(loop, at, 1e3)
    return loop


@pytest.fixture(scope="module")
def judged():
    run = jax.jit(assess)

    def judge(loop, smoother=None):
        lanes = lambda of: jax.tree.map(lambda x: np.asarray(x)[None], of)
        sea = loop.scenario.sea(KEY)
        metrics, witness = lanes(run(loop, sea))
        smooth = None if smoother is None else lanes(run(smoother, sea))[0]
        return ledger(loop, metrics, witness, smooth)

    judge.run = run
    return judge


def broken_names(entries):
    return {name for name, entry in entries.items() if entry.holds["k"] == 0}


def test_every_assumption_holds_where_none_is_broken(sound, judged):
    entries = judged(sound, with_smoothing(sound, 0.1))
    assert list(entries) == list(TITLES)
    assert broken_names(entries) == set(), to_dict(entries)
    for entry in entries.values():
        assert entry.holds["n"] == 1
        assert entry.holds["interval"] == list(clopper_pearson(1, 1))


PERFORMANCE = "controller.funnel.performance"


def _late_pitch(loop, initial):
    return changed(
        loop, lambda x: x.controller.funnel.performance.pitch.initial, initial
    )


BROKEN = {
    # The funnel starts at 0.66 where the error is 0.71.
    "inside-at-restart": lambda x: changed(
        _late_pitch(x, 0.01),
        lambda x: x.controller.funnel.performance.pitch.final_bound,
        0.01,
    ),
    # At 0.73, of which 0.71 is more than 95 %.
    "within-linear-tail": lambda x: changed(
        _late_pitch(x, 0.01),
        lambda x: x.controller.funnel.performance.pitch.final_bound,
        0.082,
    ),
    "unsaturated": lambda x: changed(
        x, lambda x: x.scenario.actuators.mass_position.limit, 1e-3
    ),
    "disturbance-rate": lambda x: changed(x, lambda x: x.observer.integral, 0.02),
    "observer-settled": lambda x: changed(
        changed(x, lambda x: x.observer.integral, 1e-6),
        lambda x: x.observer.proportional,
        1e-6,
    ),
    "tick": lambda x: changed(x, lambda x: x.controller.gains.heading.mu, 1.2),
}


@pytest.mark.parametrize("name", BROKEN)
def test_an_assumption_broken_on_purpose_is_found(sound, judged, name):
    entries = judged(BROKEN[name](sound))
    assert entries[name].holds["k"] == 0, entries[name]
    # And what is broken is not blamed on what has nothing to do with it.
    allowed = {
        "inside-at-restart": {"within-linear-tail"},
        "observer-settled": {"disturbance-rate"},
        "disturbance-rate": {"observer-settled"},
        # Chatter from tick to tick is a disturbance that changes fast.
        "tick": {"disturbance-rate", "observer-settled"},
        "unsaturated": {"within-linear-tail", "observer-settled"},
    }.get(name, set())
    assert broken_names(entries) <= {name} | allowed, to_dict(entries)


def test_smoothing_that_matters_is_found(sound, judged):
    coarse = changed(sound, lambda x: x.controller.smoothing, 3.0)
    entries = judged(coarse, with_smoothing(coarse, 0.1))
    assert "smoothing" in broken_names(entries)


def test_the_witness_is_what_the_ticks_say(sound, judged, simulate_jit):
    loop = BROKEN["inside-at-restart"](sound)
    sea = loop.scenario.sea(KEY)
    metrics, seen = judged.run(loop, sea)
    run = simulate_jit(loop, sea)
    assert float(metrics.channels.pitch.rms_error) == pytest.approx(
        float(run.metrics.channels.pitch.rms_error), rel=1e-9
    )
    ticks = jax.device_get(run.ticks)
    restart = np.concatenate([[True], np.diff(ticks.clock) < 0.0])
    assert restart.sum() == 4
    for channel in CHANNELS:
        error, edge = getattr(ticks.error, channel), getattr(ticks.law_limits, channel)
        near = np.maximum(error / edge.upper, error / edge.lower)
        found = float(getattr(seen.at_restart, channel))
        assert found == pytest.approx(near[restart].max(), rel=1e-6)
        assert float(getattr(seen.nearness, channel)) == pytest.approx(
            near.max(), rel=1e-6
        )
    late = ticks.clock >= 8.0
    for axis in vars(ticks.lumped):
        d, estimate = getattr(ticks.lumped, axis), getattr(ticks.estimate, axis)
        rate = np.abs(np.diff(d)).max() / float(loop.scenario.clock.dt)
        assert float(getattr(seen.disturbance_rate, axis)) == pytest.approx(
            rate, rel=1e-5, abs=1e-9
        )
        off = np.abs(estimate - d)[late].max()
        assert float(getattr(seen.late_error, axis)) == pytest.approx(
            off, rel=1e-5, abs=1e-9
        )


def slope_at_zero(power, width):
    """Of x (x² + δ²)^((p − 1)/2), from a difference."""
    x = 1e-9
    return (x * x + width**2) ** ((power - 1) / 2)


def test_the_fastest_rate_is_that_of_the_linear_law(sound):
    """The slope of the reaching law, and the roots of ε'' on the surface."""
    law, rates, x = sound.controller, [], jnp.asarray(1e-9)
    width = float(law.smoothing)
    for gains in vars(law.gains).values():
        slope = float(reaching_law(x, gains.mu, law.smoothing) / x)
        rates.append(float(gains.k1 + gains.k2) * slope)
        on_error, on_rate = (
            1.0 + sum(slope_at_zero(float(p), width) for p in powers)
            for powers in law.exponents(gains.rho)
        )
        roots = np.roots([1.0, float(gains.k2) * on_rate, float(gains.k1) * on_error])
        rates.extend(np.abs(roots))
    assert float(fastest_rate(law)) == pytest.approx(max(rates), rel=1e-6)


@pytest.mark.parametrize(("law", "rate"), [("smc", 6.0), ("ppc", None)])
def test_the_other_laws_have_a_rate_too(law, rate):
    controller = paper.make_loop("switching", "printed", law).controller
    if rate is None:
        # λ at no error is 1/P, and l1 + l2 = 1.1, 1.1, 3.1.
        bounds = [0.2, np.pi / 18, np.pi / 12]
        rate = max(x / p for x, p in zip((1.1, 1.1, 3.1), bounds, strict=True))
    assert float(fastest_rate(controller)) == pytest.approx(rate)


def test_the_observer_set_is_that_of_the_search():
    rng = np.random.default_rng(0)
    first, second, rate = np.exp(rng.uniform(-4, 4, (3, 300)))
    expected = [in_observer_set(*x) for x in zip(first, second, rate, strict=True)]
    assert observer_set_holds(first, second, rate).tolist() == expected
    assert 50 < sum(expected) < 250


def test_of_a_failed_run_nothing_holds(sound, judged):
    sea = sound.scenario.sea(KEY)
    metrics, witness = judged.run(sound, sea)
    two = jax.tree.map(lambda x: np.stack([x, x]), (metrics, witness))
    failed = eqx.tree_at(lambda m: m.finite, two[0], np.asarray([True, False]))
    for entry in ledger(sound, failed, two[1]).values():
        assert entry.holds["k"] == 1
        assert entry.holds["n"] == 2


def test_a_law_without_funnel_or_observer_has_a_shorter_ledger(judged):
    loop = paper.make_loop("switching", "printed", "smc", duration=2.0)
    sea = loop.scenario.sea(KEY)
    out = jax.tree.map(lambda x: np.asarray(x)[None], jax.jit(assess)(loop, sea))
    assert list(ledger(loop, *out)) == ["unsaturated", "tick"]
    assert with_smoothing(loop, 0.1) is None


def test_a_ledger_reads_as_lines_and_as_a_table(sound, judged):
    entries = to_dict(judged(sound))
    lines = text_ledger(entries)
    assert len(lines) == 1 + len(entries)
    assert "1 of 1 [0.025, 1]" in lines[1]
    assert len(markdown_ledger(entries)) == 3 + len(entries)


def test_each_part_of_a_specification_is_counted():
    specification = Specification(
        paper.funnel("switching"), largest_roll=0.5, saturated_share=0.1
    )
    columns = {
        f"{c}.{m.name}": np.zeros(4)
        for c in CHANNELS
        for m in dataclasses.fields(ChannelMetrics)
    }
    columns["max_roll"] = np.asarray([0.4, 0.6, 0.4, 0.4])
    columns["pitch.time_saturated"] = np.asarray([0.0, 0.0, 0.2, 0.0])
    failed = np.asarray([False, False, False, True])
    flags = violations(columns.__getitem__, failed, specification)
    assert flags["bank"].tolist() == [False, True, False, True]
    assert flags["saturation"].tolist() == [False, False, True, True]
    assert flags["depth"].tolist() == [False, False, False, True]
    assert broken(flags).tolist() == [False, True, True, True]
    assert set(violations(columns.__getitem__, failed, None)) == set(CHANNELS)
