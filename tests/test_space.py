"""The search space: its sets hold whatever the free numbers are."""

import dataclasses
import math
import re
from operator import attrgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from jaxglider import NoObserver, map_members, paper
from jaxglider.control import AbstractController
from jaxglider.control.catalogue import BY_NAME
from jaxglider.control.prescribed.performance import ExponentialFunction
from jaxglider.core.containers import as_float
from jaxglider.core.sets import K1_BELOW_K2, OBSERVER_SET, Coupled, Interval
from jaxglider.guidance import LineOfSight
from jaxglider.signals import BodyAxes, Channels
from tuning.space.bijections import Above, Below, Positive, bend, unbend
from tuning.space.coordinates import expand, tunable_paths
from tuning.space.space import Space

CHANNELS = ("depth", "pitch", "heading")
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
ACTUATORS = ("buoyancy_mass", "mass_position", "mass_angle")
RATES = BodyAxes(6e-4, 3e-4, 0.02, 3e-4, 0.2, 6.0)
EVERYTHING = ("controller", "observer", "scenario")
FUNNEL = "controller.funnel.performance"


KINDS = ("fxtppc", "fxtppc-roll", "exponential", "ppc", "smc")


def make_loop(kind):
    if kind == "exponential":
        loop = paper.make_loop("waypoints")
        exponential = paper.funnel("waypoints").performance
        forms = [
            ExponentialFunction(1.0, p.final_bound, p.settling_time)
            for p in vars(exponential).values()
        ]
        return eqx.tree_at(
            lambda at: list(vars(at.controller.funnel.performance).values()),
            loop,
            forms,
        )
    return paper.make_loop("waypoints", "printed", kind)


@pytest.mark.parametrize("name", BY_NAME)
def test_every_law_of_the_catalogue_can_be_searched(name):
    """As it begins: a gain of zero has no logarithm, and needs an end to its set."""
    loop = paper.make_loop("switching", "seawing", name)
    space = Space.of(loop, ["controller"])
    written = space.write(loop, space.read(loop))
    for path in space.names:
        assert np.isfinite(float(attrgetter(path)(written))), path


@pytest.fixture(scope="module")
def loops():
    return {kind: make_loop(kind) for kind in KINDS}


@pytest.fixture(scope="module")
def loop(loops):
    return loops["fxtppc"]


def single(loop):
    return jax.tree.map(
        lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x,
        loop,
    )


def at(loop, path):
    return attrgetter(path)(loop)


def numbers(loop, paths):
    return [at(loop, path) for path in paths]


def with_values(loop, values):
    paths = list(values)
    old = numbers(loop, paths)
    new = [jnp.asarray(values[p], o.dtype) for p, o in zip(paths, old, strict=True)]
    return eqx.tree_at(lambda a: numbers(a, paths), loop, new)


def in_blocks(function, block=64):
    """Compiled for many rows, as members of an ensemble are.

    What is inside a loop compiles in a third of the time of the same without one.
    """
    return jax.jit(lambda rows: map_members(function, rows, block=block))


def alone(function, *given):
    """The function by itself, not in lanes; twice, or it would be no loop."""
    twice = [np.stack([x, x]) for x in given]
    found = in_blocks(lambda x: function(*x), block=1)(twice)
    return jax.tree.map(lambda x: x[0], found)


def everything(loop, kind):
    """The widest space of a loop: every number, every constraint that applies."""
    if kind == "smc":
        return Space.of(loop, ["controller", "scenario"])
    constraints = (K1_BELOW_K2, OBSERVER_SET)
    return Space.of(loop, EVERYTHING, constraints, RATES)


def test_the_tunable_numbers_of_the_proposed_law_are_these(loop):
    performance = [
        f"{FUNNEL}.{c}.{n}"
        for c in CHANNELS
        for n in ("initial", "final_bound", "settling_time")
    ]
    transformation = [
        f"controller.funnel.transformation.{c}.{n}"
        for c in CHANNELS
        for n in ("lower", "upper")
    ]
    gains = [
        f"controller.gains.{c}.{n}" for c in CHANNELS for n in ("k1", "k2", "rho", "mu")
    ]
    damping = [f"controller.damping.{n}" for n in ACTUATORS]
    observer = [
        f"observer.{g}.{a}"
        for g in ("proportional", "integral", "stretch")
        for a in AXES
    ]
    guidance = [
        f"scenario.reference.line_of_sight.{n}" for n in ("lookahead", "integral_gain")
    ]
    expected = performance + transformation + gains + damping + observer + guidance
    assert tunable_paths(loop) == tuple(expected)


def test_a_law_that_ignores_its_funnel_has_no_funnel_to_tune(loops):
    names = tunable_paths(loops["smc"])
    assert set(names) == {
        *(f"controller.{g}.{c}" for g in ("c0", "c1", "c2") for c in CHANNELS),
        *(f"controller.damping.{n}" for n in ACTUATORS),
        "scenario.reference.line_of_sight.lookahead",
        "scenario.reference.line_of_sight.integral_gain",
    }


def test_a_schedule_has_no_guidance_to_tune():
    assert not [p for p in tunable_paths(paper.make_loop()) if p.startswith("scenario")]


def test_a_path_may_end_early_or_leave_a_component_open(loop):
    stars = Space.of(loop, ["controller.gains.*.k1", "controller.damping"])
    assert stars.names == (
        *(f"controller.gains.{c}.k1" for c in CHANNELS),
        *(f"controller.damping.{n}" for n in ACTUATORS),
    )
    twice = Space.of(loop, ["controller.gains.pitch.mu", "controller.gains.*.mu"])
    assert twice.names == tuple(
        f"controller.gains.{c}.mu" for c in ("pitch", "depth", "heading")
    )
    assert len(Space.of(loop, EVERYTHING).names) == 50


def test_a_name_alone_stands_for_all_whose_path_has_it(loop):
    """So that one tunes the heading without knowing where its numbers are."""
    whole = tunable_paths(loop)
    heading = Space.of(loop, ["heading"]).names
    assert heading == tuple(
        p for p in whole if p.endswith(".heading") or ".heading." in p
    )
    assert "controller.gains.heading.k1" in heading
    # What begins a path is that path, as ever.
    inside = [p for p in whole if p.startswith("controller.")]
    assert Space.of(loop, ["controller"]).names == tuple(inside)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("gains.depth.k1", r"'gains\.depth\.k1'.*controller\.gains\.depth\.k1"),
        ("controller.gains.dept.k1", r"did you mean controller\.gains\.depth\.k1"),
        ("controller.gains.depth.k3", r"controller\.gains\.depth\.k[12]"),
        ("headin", r"did you mean heading"),
        ("controller.smoothing", r"'controller\.smoothing' names nothing to tune"),
        ("controller.model", r"names nothing to tune"),
        ("scenario.clock.dt", r"names nothing to tune"),
        (
            "zzz",
            r"choose from controller\.damping.*scenario\.reference or .*\(50 in all",
        ),
    ],
)
def test_an_unknown_path_is_named_with_its_neighbours(loop, path, words):
    with pytest.raises(ValueError, match=words):
        Space.of(loop, ["controller.damping", path])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"constraints": ("k1",)}, r"k1-below-k2-squared, .*observer-set.*'k1'"),
        ({"constraints": (OBSERVER_SET,)}, r"the constraint alone"),
        ({"disturbance_rate_bound": RATES}, r"the bound alone"),
        (
            {
                "constraints": (OBSERVER_SET,),
                "disturbance_rate_bound": BodyAxes(1.0, 1.0, 1.0, 0.0, 1.0, 1.0),
            },
            r"disturbance_rate_bound\.roll must be in \(0, 10000\]; received 0",
        ),
    ],
)
def test_constraints_that_cannot_be_meant_are_refused(loop, options, words):
    with pytest.raises(ValueError, match=words):
        Space.of(loop, ["observer"], **options)


def test_no_path_at_all_is_refused(loop):
    with pytest.raises(ValueError, match="paths is empty"):
        Space.of(loop, [])


def test_a_gain_that_starts_at_zero_is_refused(loop):
    path = "scenario.reference.line_of_sight"
    still = eqx.tree_at(lambda a: at(a, path), loop, LineOfSight(2.5, 0.0))
    with pytest.raises(
        ValueError, match=r"integral_gain must start between.*received 0"
    ):
        Space.of(still, [path])
    assert Space.of(still, [f"{path}.lookahead"]).values(still) == {
        f"{path}.lookahead": 2.5
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_the_paper_gains_come_back(loops, kind, precision):
    loop = loops[kind] if precision == np.float64 else single(loops[kind])
    space = Space.of(loop, tunable_paths(loop), constraints=())
    free = space.read(loop)
    assert free.dtype == precision
    written = space.write(loop, free)
    before, after = space.values(loop), space.values(written)
    for path, value in before.items():
        wanted = 0.99 if "transformation" in path else value
        if kind == "exponential" and path.endswith("initial"):
            wanted = 1.01
        assert after[path] == pytest.approx(
            wanted, rel=20 * float(np.finfo(precision).eps)
        )
    assert jax.tree.structure(written) == jax.tree.structure(loop)
    assert [x.dtype for x in jax.tree.leaves(written)] == [
        x.dtype for x in jax.tree.leaves(loop)
    ]


def test_what_is_not_tuned_is_not_touched(loop):
    space = Space.of(loop, ["controller.gains.pitch.k2", f"{FUNNEL}.pitch.final_bound"])
    written = space.write(loop, space.read(loop) + 0.3)
    differ = [
        jax.tree_util.keystr(path)
        for (path, a), b in zip(
            jax.tree_util.tree_leaves_with_path(loop),
            jax.tree.leaves(written),
            strict=True,
        )
        if not np.array_equal(a, b)
    ]
    assert differ == [
        ".controller.funnel.performance.pitch.final_bound",
        ".controller.gains.pitch.k2",
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_free_numbers_come_back(loops, kind):
    loop = loops[kind]
    space = everything(loop, kind)
    write = in_blocks(lambda x: numbers(space.write(loop, x), space.names), block=1)
    centre = space.read(loop)
    noise = np.random.default_rng(0).standard_normal((3, len(centre)))
    frees = centre + np.clip(noise, -2.0, 2.0)
    for free, *values in zip(frees, *write(frees), strict=True):
        written = with_values(loop, dict(zip(space.names, values, strict=True)))
        np.testing.assert_allclose(space.read(written), free, atol=1e-8)


def test_bent_numbers_are_themselves_up_to_twenty_and_come_back_beyond():
    free = jnp.linspace(-50.0, 50.0, 2001)
    bent = bend(free)
    inner = np.abs(free) <= 20.0
    np.testing.assert_array_equal(bent[inner], free[inner])
    outer = 20.0 + 10.0 * np.tanh((np.abs(free) - 20.0) / 10.0)
    np.testing.assert_allclose(
        bent[~inner], (np.sign(free) * outer)[~inner], rtol=1e-14
    )
    assert np.all(np.diff(bent) > 0.0)
    np.testing.assert_allclose(unbend(np.asarray(bent)), free, rtol=1e-9)


def test_a_step_is_a_ratio_of_gains_and_leaves_the_others_alone(loop):
    """Far from its edge k2 follows its free number alone, and k1 always does."""
    space = Space.of(loop, ["controller.gains.pitch.*"])
    roomy = with_values(loop, {"controller.gains.pitch.k2": 50.0})
    free = space.read(roomy)
    steps = jnp.array([math.log(2.0), math.log(3.0), 0.0, 0.0])
    written = space.values(space.write(roomy, free + steps))
    gains = "controller.gains.pitch"
    assert written[f"{gains}.k1"] == pytest.approx(0.02)
    assert written[f"{gains}.k2"] == pytest.approx(150.0, rel=3e-3)
    assert written[f"{gains}.rho"] == pytest.approx(0.8)
    assert written[f"{gains}.mu"] == pytest.approx(2.0)


def rules(value, kind, mode):
    """Name and truth of every rule of the theory, by plain NumPy; `value` by path.

    Written from the theory and not from the code: arrays of one entry per try.
    """
    for path, x in value.items():
        yield f"{path} finite and positive", np.isfinite(x) & (x > 0.0)
    if kind == "fxtppc-roll":
        quarter = value["controller.largest_angle"].astype(np.float64)
        yield "a quarter of a turn", quarter <= np.pi / 2
        yield "hedging", value["controller.hedging"] <= 1.0
        # What is left is the law inside.
        inside = "controller.law."
        value = {k.replace(inside, "controller."): x for k, x in value.items()}
        kind = "fxtppc"
    if kind in ("fxtppc", "exponential", "ppc"):
        for c in CHANNELS:
            for side in ("lower", "upper"):
                delta = value[f"controller.funnel.transformation.{c}.{side}"]
                yield f"delta {c} {side}", delta <= 1.0
            initial = value[f"{FUNNEL}.{c}.initial"]
            bound = value[f"{FUNNEL}.{c}.final_bound"]
            if kind == "fxtppc":
                # In the precision of the numbers, as their constructor checks it, and
                # in double precision.
                yield f"sech {c}", bound < 1.0 / np.cosh(initial)
                wide = initial.astype(np.float64)
                yield f"sech {c} exactly", bound < 1.0 / np.cosh(wide)
            if kind == "exponential":
                yield f"exponential {c}", initial >= 1.0
    if kind in ("fxtppc", "exponential"):
        for c in CHANNELS:
            k1, k2, rho, mu = (
                value[f"controller.gains.{c}.{n}"] for n in ("k1", "k2", "rho", "mu")
            )
            yield f"k1 {c}", k1 < 0.75 * k2.astype(np.float64) ** 2
            yield f"rho {c}", rho < 1.0
            yield f"mu {c}", mu > 1.0
    if kind != "smc":
        for axis, rate in vars(RATES).items():
            p = value[f"observer.proportional.{axis}"].astype(np.float64)
            i = value[f"observer.integral.{axis}"].astype(np.float64)
            d = float(rate)
            low = p <= 2.0 * np.sqrt(d)
            first = low & (i > p**2 / 4.0 + 4.0 * d**2 / p**2)
            yield f"observer {axis} ({mode})", first | (~low & (i > d))


def tries(size, precision):
    """Free vectors of all magnitudes, whole corners among them."""
    rng = np.random.default_rng(7)
    blocks = [
        scale * rng.standard_normal((60, size))
        for scale in (1.0, 10.0, 30.0, 1e3, 1e30)
    ]
    blocks.append(rng.choice([-30.0, 30.0, -1e300, 1e300, 0.0], (200, size)))
    blocks.append(rng.choice([-np.inf, np.inf], (20, size)))
    blocks += [np.full((1, size), x) for x in (-1e30, 1e30, -17.0, 17.0, 0.0)]
    with np.errstate(over="ignore"):
        return np.concatenate(blocks).astype(precision)


MODES = {
    "everything": lambda p: True,
    "one of each pair": lambda p: p.endswith(("k1", "initial")) or "proport" in p,
    "the other": lambda p: p.endswith(("k2", "final_bound")) or "integral." in p,
}
CASES = [
    (kind, mode)
    for kind in KINDS
    for mode in (MODES if kind == "fxtppc" else ["everything"])
]


@pytest.mark.parametrize(("kind", "mode"), CASES)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_every_set_holds_for_any_free_numbers(loops, kind, mode, precision):
    loop = loops[kind]
    if kind != "smc":
        # What stays fixed must be inside: the paper's depth and observer gains are not.
        inside = everything(loop, kind)
        loop = inside.write(loop, inside.read(loop))
    loop = loop if precision == np.float64 else single(loop)
    paths = [p for p in tunable_paths(loop) if MODES[mode](p)]
    set_ = {"constraints": (K1_BELOW_K2, OBSERVER_SET), "disturbance_rate_bound": RATES}
    space = Space.of(loop, paths, **({} if kind == "smc" else set_))
    names = tunable_paths(loop)

    written = in_blocks(lambda free: numbers(space.write(loop, free), names))
    free = tries(len(paths), precision)
    value = dict(zip(names, map(np.asarray, written(free)), strict=True))
    assert {x.dtype for x in value.values()} == {np.dtype(precision)}
    for name, holds in rules(value, kind, mode):
        assert np.all(holds), (name, free[~holds][:1])
    for row in range(0, len(free), 60):
        tried = with_values(loop, {path: x[row] for path, x in value.items()})
        assert space.bounds_hold(tried) == []


@pytest.fixture(scope="module")
def small(loop):
    """A space of the coupled gains, and its compiled writing."""
    paths = ["controller.gains.depth", f"{FUNNEL}.depth"]
    space = Space.of(loop, paths)
    return space, jax.jit(lambda x: numbers(space.write(loop, x), space.names))


@settings(max_examples=200, deadline=None)
@given(free=st.lists(st.floats(allow_nan=False), min_size=7, max_size=7))
def test_the_coupled_sets_hold_for_what_hypothesis_thinks_of(small, free):
    space, write = small
    gain = {
        path.rpartition(".")[2]: float(x)
        for path, x in zip(space.names, write(jnp.asarray(free)), strict=True)
    }
    assert 0.0 < gain["k1"] < 0.75 * gain["k2"] ** 2 < math.inf
    assert 0.0 < gain["rho"] < 1.0 < gain["mu"] < math.inf
    assert 0.0 < gain["final_bound"] < 1.0 / math.cosh(gain["initial"])
    assert 0.0 < gain["settling_time"] < math.inf


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("controller.gains.pitch.k2", 0.1, r"pitch\.k2 = 0\.1 with .*k1 < 3/4 k2\^2"),
        ("controller.gains.pitch.k2", np.nan, r"pitch\.k2 = nan"),
        ("controller.gains.heading.rho", 1.0, r"rho = 1 breaks its rule: in \(0, 1\)"),
        ("controller.gains.heading.mu", 1.0, r"mu = 1 breaks its rule: above 1"),
        ("controller.damping.mass_angle", 0.0, r"mass_angle = 0 .*positive"),
        (f"{FUNNEL}.depth.final_bound", 0.7, r"final_bound = 0\.7 with .*sech"),
        ("controller.funnel.transformation.depth.lower", 1.5, r"in \(0, 1\]"),
    ],
)
def test_a_broken_rule_is_reported(loop, path, value, words):
    space = everything(loop, "fxtppc")
    inside = space.write(loop, space.read(loop))
    assert space.bounds_hold(inside) == []
    (broken,) = space.bounds_hold(with_values(inside, {path: value}))
    assert re.search(words, broken), broken


@pytest.mark.parametrize(
    ("proportional", "integral", "inside"),
    [
        (2.0, 37.1, True),
        (2.0, 36.9, False),
        (4.8, 12.1, True),
        (4.8, 12.0, False),
        (5.0, 6.1, True),
        (5.0, 5.9, False),
    ],
)
def test_the_observer_set_is_the_published_one(loop, proportional, integral, inside):
    """For a rate of 6: ι₁²/4 + 144/ι₁² up to ι₁ = 4.899, and 6 beyond."""
    space = everything(loop, "fxtppc")
    values = (proportional, integral)
    paths = ("observer.proportional.yaw", "observer.integral.yaw")
    started = space.write(loop, space.read(loop))
    broken = space.bounds_hold(
        with_values(started, dict(zip(paths, values, strict=True)))
    )
    assert len(broken) == (0 if inside else 1)
    assert inside or "observer set for a disturbance rate up to 6" in broken[0]


@pytest.mark.parametrize("kind", ["fxtppc", "exponential"])
def test_the_derivative_is_that_of_the_difference(loops, kind):
    loop = loops[kind]
    space = everything(loop, kind)
    if kind == "exponential":
        space = Space.of(loop, [FUNNEL])
    centre = space.read(loop)
    noise = np.random.default_rng(1).standard_normal(centre.shape)
    free, h = centre + 0.5 * noise, 1e-5
    write = lambda x: jnp.log(jnp.stack(numbers(space.write(loop, x), space.names)))
    shifts = h * np.eye(len(free))
    batch = in_blocks(write)(np.concatenate([free + shifts, free - shifts]))
    up, down = np.split(np.asarray(batch), 2)
    difference = ((up - down) / (2.0 * h)).T
    reverse = alone(jax.jacrev(write), free)
    np.testing.assert_allclose(reverse, difference, rtol=1e-6, atol=1e-9)
    forward = alone(lambda x, t: jax.jvp(write, (x,), (t,))[1], free, noise)
    np.testing.assert_allclose(forward, reverse @ noise, rtol=1e-9, atol=1e-12)
    assert np.all(np.diag(reverse) > 1e-3)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_gradients_are_finite_up_to_thirty_and_beyond(loop, precision):
    loop = loop if precision == np.float64 else single(loop)
    space = everything(loop, "fxtppc")

    def log_sum(free):
        return jnp.sum(
            jnp.log(jnp.stack(numbers(space.write(loop, free), space.names)))
        )

    free = tries(len(space.names), precision)
    slopes = np.asarray(in_blocks(jax.grad(log_sum))(free))
    assert np.all(np.isfinite(slopes))
    usual = np.abs(free).max(axis=1) <= 30.0
    assert np.all(np.max(np.abs(slopes[usual]), axis=1) > 1e-3)


def test_writing_a_batch_is_writing_one_by_one(loop):
    space = everything(loop, "fxtppc")
    noise = np.random.default_rng(2).standard_normal((3, len(space.names)))
    free = space.read(loop) + 0.3 * noise
    write = jax.jit(lambda x: numbers(space.write(loop, x), space.names))
    batch = jax.jit(jax.vmap(write))(free)
    for n in range(3):
        np.testing.assert_allclose([x[n] for x in batch], write(free[n]), rtol=1e-14)


def test_the_paper_depth_gains_start_from_the_nearest_point_and_are_named(loop):
    space = Space.of(loop, ["controller.gains"])
    assert len(space.notes) == 1
    note = space.notes[0]
    for words in (
        "k1 < 3/4 k2^2",
        "controller.gains.depth.k1 from 0.001 to 0.000584",
        "controller.gains.depth.k2 from 0.01 to 0.0293",
    ):
        assert words in note
    started = space.values(space.write(loop, space.read(loop)))
    asked = space.values(loop)
    moved = [path for path in asked if started[path] != pytest.approx(asked[path])]
    assert moved == ["controller.gains.depth.k1", "controller.gains.depth.k2"]


def test_a_constraint_is_switched_off_by_name(loop):
    space = Space.of(loop, ["controller.gains"], constraints=())
    started = space.write(loop, space.read(loop))
    assert started.controller.gains.depth.k1 == pytest.approx(0.001)
    assert started.controller.gains.depth.k2 == pytest.approx(0.01)
    assert space.bounds_hold(started) == []
    (note,) = space.notes
    assert "controller.gains.depth.k1 = 0.001" in note
    assert "k1-below-k2-squared is not held" in note


def test_gains_that_are_not_tuned_stay_where_they_are_and_are_named(loop):
    space = Space.of(loop, ["controller.damping"])
    (note,) = space.notes
    assert "controller.gains.depth.k2 = 0.01" in note
    assert "neither is tuned" in note
    assert space.bounds_hold(loop) == []


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("k1", 0.75 * 0.01**2 * 0.95), ("k2", math.sqrt(0.001 / 0.75) * 1.05)],
)
def test_a_gain_tuned_alone_moves_alone(loop, name, wanted):
    path = f"controller.gains.depth.{name}"
    space = Space.of(loop, [path])
    started = space.write(loop, space.read(loop))
    assert float(at(started, path)) == pytest.approx(wanted)
    assert space.bounds_hold(started) == []
    other = "controller.gains.depth." + {"k1": "k2", "k2": "k1"}[name]
    assert at(started, other) == at(loop, other)
    assert other not in space.notes[0]


@pytest.mark.parametrize(
    ("k1", "k2"), [(0.001, 0.01), (1.0, 1.0), (1e3, 1e-3), (0.76, 1.0)]
)
def test_no_point_inside_is_nearer_to_the_start_than_that_of_k1_and_k2(loop, k1, k2):
    """Against a constrained minimisation by another program, in logarithms."""
    paths = ["controller.gains.pitch.k1", "controller.gains.pitch.k2"]
    start = with_values(loop, dict(zip(paths, (k1, k2), strict=True)))
    space = Space.of(start, paths)
    found = np.log(list(space.values(space.write(start, space.read(start))).values()))
    asked = np.log([k1, k2])
    best = minimize(
        lambda x: np.sum((x - asked) ** 2),
        asked,
        constraints={
            "type": "ineq",
            "fun": lambda x: x[1] - np.log(1.05) - 0.5 * (np.log(4.0 / 3.0) + x[0]),
        },
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    np.testing.assert_allclose(found, best.x, atol=1e-6)


@pytest.mark.parametrize(
    ("proportional", "integral", "rate"),
    [(0.001, 0.01, 6e-4), (0.01, 0.01, 0.02), (5.0, 1.0, 2.0), (1.0, 1e-3, 0.3)],
)
def test_no_point_inside_is_nearer_to_the_start_than_that_of_the_observer(
    loop, proportional, integral, rate
):
    """Against all points of a fine grid of the set that the search keeps to."""
    paths = ["observer.proportional.heave", "observer.integral.heave"]
    values = dict(zip(paths, (proportional, integral), strict=True))
    start = with_values(loop, values)
    bounds = BodyAxes(1e-9, 1e-9, rate, 1e-9, 1e-9, 1e-9)
    space = Space.of(start, paths, (OBSERVER_SET,), bounds)
    found = space.values(space.write(start, space.read(start)))
    a = np.linspace(-12.0, 6.0, 1_800_001)
    q = 2.0 * a - np.log(4.0 * rate)
    edge = np.where(q < 0.0, 2.0 * np.cosh(q), 1.0 + 1.0 / (1.0 + 100.0 * q**2))
    b = np.maximum(np.log(1.05 * rate * edge), np.log(integral))
    grid = np.hypot(a - np.log(proportional), b - np.log(integral))
    distance = math.hypot(
        math.log(found[paths[0]] / proportional), math.log(found[paths[1]] / integral)
    )
    assert distance == pytest.approx(grid.min(), rel=1e-6)
    assert space.bounds_hold(with_values(start, found)) == []
    assert f"{paths[0]} from {proportional:g}" in space.notes[0] or proportional == 5.0


def test_an_observer_inside_its_set_is_not_moved(loop):
    rates = BodyAxes(1e-6, 1e-6, 1e-4, 1e-4, 1e-4, 1e-4)
    space = Space.of(loop, ["observer"], (OBSERVER_SET,), rates)
    assert not [note for note in space.notes if "observer" in note]
    written = space.values(space.write(loop, space.read(loop)))
    assert written == pytest.approx(space.values(loop), rel=1e-12)


def test_an_observer_gain_that_no_other_can_help_is_refused(loop):
    rates = BodyAxes(1.0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6)
    with pytest.raises(
        ValueError, match=r"no observer\.proportional\.surge.*tune both"
    ):
        Space.of(loop, ["observer.proportional"], (OBSERVER_SET,), rates)


def test_a_loop_without_observer_has_no_observer_set(loops):
    space = Space.of(loops["smc"], ["controller.c0"], (OBSERVER_SET,), RATES)
    assert space.notes == ("observer-set has nothing to hold in a NoObserver.",)


def test_a_start_on_a_closed_end_moves_just_inside_and_one_note_says_so(loop):
    space = Space.of(loop, ["controller.funnel.transformation"])
    (note,) = [note for note in space.notes if "funnel" in note]
    assert note.startswith("6 numbers of controller.funnel.transformation (")
    assert "from 0.99 instead of 1" in note
    started = space.values(space.write(loop, space.read(loop)))
    assert list(started.values()) == pytest.approx([0.99] * 6)
    depth = Space.of(loop, ["controller.funnel.transformation.depth"])
    (note,) = [note for note in depth.notes if "funnel" in note]
    assert note.count("controller.funnel.transformation.depth.") == 2


def test_a_fixed_final_bound_caps_the_initial_value(loop):
    """sech(P0) stays above it, and P0 comes as near to arcsech as may be."""
    path = f"{FUNNEL}.depth.initial"
    space = Space.of(loop, [path])
    far = float(at(space.write(loop, jnp.array([1e3])), path))
    assert far < math.acosh(1.0 / 0.5)
    assert far == pytest.approx(math.acosh(1.0 / 0.5), rel=5e-5)


def test_the_observer_edge_has_no_jump_where_the_published_one_has(loop):
    """Around ι₁ = 2√D, where the published edge falls from 2D to D."""
    paths = ["observer.proportional.heave", "observer.integral.heave"]
    space = Space.of(loop, paths, (OBSERVER_SET,), RATES)
    middle = math.log(2.0 * math.sqrt(0.02))
    free = jnp.stack(
        [jnp.linspace(middle - 1, middle + 1, 401), jnp.full(401, -29.0)], 1
    )
    written = jax.jit(jax.vmap(lambda x: space.write(loop, x)))(free)
    edge = np.asarray(written.observer.integral.heave)
    assert np.abs(np.diff(edge)).max() < 0.1 * 0.02
    assert edge[200] == pytest.approx(0.04, rel=1e-4)
    assert edge[-1] == pytest.approx(0.02, rel=1e-2)


@pytest.mark.parametrize(
    ("bijection", "edge"), [(Positive(), 0.0), (Above(), 3.0), (Below(), 0.25)]
)
def test_bijections_invert_and_rise(bijection, edge):
    z = jnp.linspace(-9.0, 9.0, 181)
    gain = bijection.place(bijection.stretch(z), edge)
    assert np.all(np.diff(gain) > 0.0)
    np.testing.assert_allclose(bijection.inverse(np.asarray(gain), edge), z, atol=1e-7)


class Numbers(AbstractController):
    """A law of one's own with a field of each kind; it is never stepped."""

    model: None = None
    funnel: None = None
    plain: float = eqx.field(converter=as_float, default=3.0)
    trim: float = eqx.field(
        converter=as_float, default=-0.02, metadata={"set": Interval(-0.05, 0.04)}
    )
    share: float = eqx.field(
        converter=as_float,
        default=1.0,
        metadata={"set": Interval(0.0, 1.0, closed_high=True)},
    )
    large: Channels = eqx.field(
        default_factory=lambda: Channels(2.0, 3.0, 4.0),
        metadata={"set": Interval(1.5)},
    )
    slow: Channels = eqx.field(
        default_factory=lambda: Channels(1e-3, 1e-3, 1e-3),
        metadata={"set": Coupled(K1_BELOW_K2, "slow", "fast")},
    )
    fast: Channels = eqx.field(
        default_factory=lambda: Channels(0.1, 0.1, 1e-3),
        metadata={"set": Coupled(K1_BELOW_K2, "slow", "fast")},
    )
    kept: float = eqx.field(converter=as_float, default=7.0, metadata={"tuned": False})

    def init(self):
        return None

    def step(self, state, measurement, reference, bounds, dt):
        raise NotImplementedError


class HalfOpen(AbstractController):
    """A law with a number that ends at one side only, below zero."""

    model: None = None
    funnel: None = None
    bias: float = eqx.field(
        converter=as_float, default=0.0, metadata={"set": Interval(-1.0)}
    )

    def init(self):
        return None

    def step(self, state, measurement, reference, bounds, dt):
        raise NotImplementedError


def steered_by(loop, controller):
    return dataclasses.replace(loop, controller=controller)


def test_a_law_of_ones_own_has_its_space_from_its_fields(loop):
    """Sets, couplings and what is left out: from the metadata alone."""
    own = steered_by(loop, Numbers())
    space = Space.of(own, ["controller"])
    assert len(space.names) == 3 + 3 * 3
    assert not any("kept" in name for name in space.names)
    assert any("fast.heading" in note for note in space.notes)
    for seed in range(10):
        free = 30.0 * np.random.default_rng(seed).normal(size=len(space.names))
        law = space.write(own, jnp.asarray(free)).controller
        assert float(law.plain) > 0.0
        assert -0.05 < float(law.trim) < 0.04
        assert 0.0 < float(law.share) < 1.0
        assert float(law.kept) == 7.0
        for channel in CHANNELS:
            assert getattr(law.large, channel) > 1.5
            k1, k2 = getattr(law.slow, channel), getattr(law.fast, channel)
            assert 0.0 < k1 < 0.75 * k2**2


@pytest.mark.parametrize("trim", [-0.02, 0.0, 0.03])
def test_a_number_of_either_sign_comes_back_from_its_free_number(loop, trim):
    own = steered_by(loop, Numbers(trim=trim))
    space = Space.of(own, ["controller.trim"])
    free = space.read(own)
    # The logit of the share of the interval, but for the margin of 1e-5.
    share = (trim + 0.05) / 0.09
    assert float(free[0]) == pytest.approx(math.log(share / (1.0 - share)), abs=1e-4)
    again = float(space.write(own, free).controller.trim)
    assert again == pytest.approx(trim, abs=1e-15)


def test_a_start_at_an_end_of_its_interval_is_moved_inside(loop):
    class Closed(AbstractController):
        model: None = None
        funnel: None = None
        trim: float = eqx.field(
            converter=as_float,
            default=-0.05,
            metadata={"set": Interval(-0.05, 0.05, closed_low=True)},
        )
        init, step = Numbers.init, Numbers.step

    space = Space.of(steered_by(loop, Closed()), ["controller.trim"])
    assert "starts from -0.049 instead of -0.05" in space.notes[0]


def test_a_number_outside_the_set_of_its_field_is_refused_where_it_is_built():
    with pytest.raises(ValueError, match=r"Numbers.trim must be in \(-0.05, 0.04\)"):
        Numbers(trim=0.05)
    with pytest.raises(ValueError, match=r"Numbers.large.pitch must be above 1.5"):
        Numbers(large=Channels(2.0, 1.0, 2.0))


def test_a_set_that_no_search_can_stay_in_is_refused(loop):
    with pytest.raises(ValueError, match="must have two ends or start from zero"):
        Space.of(steered_by(loop, HalfOpen()), ["controller.bias"])


class NothingFree(AbstractController):
    """A law of one's own that has no numbers."""

    model = None
    funnel = None

    def init(self):
        """No state."""
        return None

    def step(self, state, measurement, reference, bounds, dt):
        """Never called."""
        raise NotImplementedError


def test_a_law_without_numbers_to_tune_is_told_what_gains_are():
    loop = paper.make_loop("switching", "rigid-body", "smc")
    plain = dataclasses.replace(loop, controller=NothingFree(), observer=NoObserver())
    with pytest.raises(ValueError, match=r"^NothingFree has no number to tune"):
        expand(plain, ["controller"])
