"""The gradient trust report, on functions of known behaviour and on the closed loop."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.signals import GliderState
from jaxglider.simulation.metrics import empty_sums, finish
from jaxglider.simulation.rollout import evaluate
from tuning.gradient_check.check import (
    SHORT_STEPS,
    STEPS,
    Kind,
    check_gradient,
    saturation,
)
from tuning.gradient_check.comparison import compare_horizons, compare_smoothing
from tuning.gradient_check.text import (
    comparison_to_dict,
    render,
    render_comparison,
    to_dict,
)

CURVATURE = jnp.array([1.0, 3.0, 0.5])
NAMES = ("controller.a", "controller.b", "controller.c")
START = jnp.array([1.0, -2.0, 0.3])


def bowl(x):
    return 7.0 + 0.5 * jnp.sum(CURVATURE * x * x)


def one(function, at=0.7, **options):
    """The report on a function of one number."""
    return check_gradient(
        lambda x: function(x[0]), jnp.array([at]), ("gains.heading.k1",), **options
    )


def test_a_bowl_is_trusted_and_its_numbers_are_those_of_the_formula():
    report = check_gradient(bowl, START, NAMES)
    assert report.kinds == (Kind.TRUST,) * 3
    assert report.verdict == "trust (3 of 3 gains)"
    assert report.value == pytest.approx(float(bowl(START)), rel=1e-14)
    np.testing.assert_allclose(report.gradient, CURVATURE * START, rtol=1e-13)
    np.testing.assert_allclose(report.steps, STEPS)
    for row, h in zip(report.changes[-3:], STEPS[-3:], strict=True):
        slope = np.abs(CURVATURE * START)
        np.testing.assert_allclose(row, slope * h + 0.5 * CURVATURE * h * h, rtol=1e-6)
    np.testing.assert_allclose(report.prediction[-3:], 1.0, rtol=1e-9)
    np.testing.assert_allclose(report.reach, 0.1)
    assert np.all(report.error < 1e-9)
    assert report.norms[0] == pytest.approx(float(jnp.linalg.norm(CURVATURE * START)))
    assert np.std(report.copies[:, 1]) == pytest.approx(3.0 * 0.05, rel=0.8)


def test_the_bottom_of_a_bowl_is_trusted_and_not_called_without_influence():
    report = one(lambda x: 2.0 + x**2, 0.0)
    assert report.gradient[0] == 0.0
    assert report.kind is Kind.TRUST


def test_short_steps_reach_the_same_verdicts():
    rough = lambda x: x**2 + 1e-3 * jnp.sin(1e4 * x)
    assert one(lambda x: jnp.exp(x), steps=SHORT_STEPS).kind is Kind.TRUST
    assert one(rough, steps=SHORT_STEPS).kind is Kind.ROUGH
    assert one(_with_slope(1.001), steps=SHORT_STEPS).kind is Kind.WRONG


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0, 3.0])
def test_a_fine_ripple_is_exact_but_rough(phase):
    ripple = lambda x: (x - 1.0) ** 2 + 1e-3 * jnp.sin(1e6 * (x - 0.7) + phase)
    report = one(ripple)
    expected = -0.6 + 1e3 * np.cos(phase)
    assert report.gradient[0] == pytest.approx(expected, rel=1e-9)
    assert report.kind is Kind.ROUGH
    assert "average over scattered copies" in report.verdict
    assert report.reach[0] < 1e-5
    assert report.error[0] < 1e-3
    # Over 10 % the ripple cancels and the bowl's own slope, −0.6, is left.
    assert report.prediction[-1, 0] == pytest.approx(-0.6 / expected, rel=0.05)


def test_a_bend_at_some_percent_shortens_the_reach():
    """Flat past a step of 2 %, on either side."""
    plateau = lambda x: jnp.clip(x - 0.7, -0.02, 0.02)
    report = one(plateau)
    assert report.kind is Kind.TRUST
    assert report.reach[0] == pytest.approx(1e-2)
    assert report.verdicts == ("trust: up to steps of 1 %",)
    assert report.prediction[-1, 0] == pytest.approx(0.2)


def _with_slope(factor):
    """exp, with its derivative multiplied by a factor."""

    @jax.custom_jvp
    def f(x):
        return jnp.exp(x)

    @f.defjvp
    def f_jvp(primals, tangents):
        return jnp.exp(primals[0]), factor * jnp.exp(primals[0]) * tangents[0]

    return f


@pytest.mark.parametrize("factor", [-1.0, 0.0, 0.5, 1.0 + 1e-3, 1.0 + 1e-4])
def test_a_wrong_derivative_is_not_trusted(factor):
    report = one(_with_slope(factor))
    assert report.kind is Kind.WRONG
    assert "differences disagree" in report.verdict
    if factor:
        assert report.error[0] == pytest.approx(abs(1.0 - 1.0 / factor), rel=1e-3)


def test_an_error_below_the_tolerance_is_let_pass():
    assert one(_with_slope(1.0 + 1e-6)).kind is Kind.TRUST
    assert one(_with_slope(1.001), relative_tolerance=1e-2).kind is Kind.TRUST


def test_one_wrong_gain_among_good_ones_is_named_and_decides():
    wrong = _with_slope(2.0)
    loss = lambda x: x[0] ** 2 + wrong(x[1]) + x[2]
    report = check_gradient(loss, START, NAMES)
    assert report.kinds == (Kind.TRUST, Kind.WRONG, Kind.TRUST)
    assert report.verdict.startswith("do not trust: differences disagree")
    assert report.verdict.endswith("(1 of 3 gains)")


def test_what_is_not_finite_is_not_trusted():
    nowhere = one(lambda x: x * jnp.nan)
    assert nowhere.verdicts == ("do not trust: the loss is not finite here",)
    # The branch not taken has the derivative NaN.
    hidden = one(lambda x: jnp.where(x > 0.0, x, jnp.sqrt(-1.0 - x * x)))
    assert hidden.verdicts == ("do not trust: the gradient is not finite",)
    assert np.isfinite(hidden.value)
    point = one(lambda x: jnp.where(x == 0.0, x, jnp.nan), 0.0)
    assert point.kind is Kind.WRONG


def test_a_run_that_fails_nearby_limits_the_trust():
    far = one(lambda x: jnp.where(x < 0.75, x**2, jnp.nan))
    assert far.verdicts == ("trust: up to steps of 1 %",)
    near = one(lambda x: jnp.where(x < 0.705, x**2, jnp.nan))
    assert near.verdicts == ("exact but rough: the run fails at a step of 1 %",)


def test_a_saturated_gain_has_no_influence_and_the_report_says_why():
    loss = lambda x: 5.0 + jnp.clip(100.0 * x[0], -1.0, 1.0) + x[1] ** 2 + 0.0 * x[2]
    names = ("gains.heading.k1", "damping.mass_position", "observer.integral.surge")
    shares = {"depth": 0.4, "pitch": 0.2, "heading": 0.98}
    report = check_gradient(loss, START, names, saturated=shares)
    np.testing.assert_allclose(report.saturated, [0.98, 0.2, 0.2])
    assert report.kinds == (Kind.NO_INFLUENCE, Kind.TRUST, Kind.NO_INFLUENCE)
    assert report.verdicts[0] == "no influence: saturated in 98 % of all ticks"
    assert report.verdicts[2] == "no influence: the loss does not depend on it here"
    assert report.verdict == "trust (1 of 3 gains; without influence: 2)"
    silent = one(lambda x: 3.0 + 0.0 * x)
    assert silent.kind is Kind.NO_INFLUENCE


def test_saturation_is_the_mean_over_members():
    def metrics(counts):
        sums = eqx.tree_at(
            lambda s: (s.ticks, *(c.saturated for c in vars(s.channels).values())),
            empty_sums(jnp.zeros(())),
            (jnp.asarray(10.0), *counts),
        )
        state = GliderState.at_rest()
        return finish(sums, state, jnp.asarray(0), jnp.asarray(0.05))

    assert saturation(metrics(jnp.array([0.0, 1.0, 5.0]))) == pytest.approx(
        {"depth": 0.0, "pitch": 0.1, "heading": 0.5}
    )
    many = jax.vmap(metrics)(jnp.array([[0.0, 1.0, 5.0], [2.0, 1.0, 10.0]]))
    assert saturation(many) == pytest.approx(
        {"depth": 0.1, "pitch": 0.1, "heading": 0.75}
    )


@pytest.mark.parametrize(
    ("level", "kind"),
    [(1e-14, Kind.TRUST), (1e-6, Kind.TRUST), (1e-1, Kind.UNDECIDED)],
)
def test_noise_is_estimated_and_blurs_the_verdict_honestly(level, kind):
    """A scrambled ripple far finer than any step stands in for rounding."""

    def noisy(x):
        ripple = jnp.sin(3e4 * jnp.sin(1e17 * x))
        return jnp.exp(x) + jax.lax.stop_gradient(level * ripple)

    report = one(noisy)
    assert level / 4.0 < report.noise < 2.0 * level
    assert report.kind is kind
    assert ("checked to" in report.verdict) == (level == 1e-6)


def test_a_wrong_derivative_shows_through_noise():
    """Where rounding blurs the smallest steps, the larger ones still tell."""
    wrong = _with_slope(1.003)

    def noisy(x):
        ripple = jnp.sin(3e4 * jnp.sin(1e17 * x))
        return wrong(x) + jax.lax.stop_gradient(1e-11 * ripple)

    assert one(noisy).kind is Kind.WRONG


def test_the_slope_of_the_outline_is_not_taken_for_the_derivative():
    """Over large steps the ripple is gone and all of them agree on the bowl's slope."""
    report = one(lambda x: 2.0 * x + 1e-3 * jnp.sin(1e6 * (x - 0.7)))
    np.testing.assert_allclose(report.differences[-2:], 2.0, rtol=0.06)
    assert report.kind is Kind.ROUGH
    # Too fine for the smallest step: the differences cannot tell.
    finer = one(lambda x: 2.0 * x + 1e-3 * jnp.sin(1e9 * (x - 0.7)))
    assert finer.kind is Kind.UNDECIDED


def test_single_precision_is_checked_as_far_as_it_goes():
    report = check_gradient(
        lambda x: jnp.sum(jnp.exp(x)), jnp.array([0.5, -7.0], jnp.float32), ("a", "b")
    )
    assert Kind.WRONG not in report.kinds
    assert report.kinds[0] is Kind.TRUST
    assert "checked to" in report.verdicts[0]


def test_steps_follow_the_scale_of_each_number():
    """In units of 1e3 the function is as gentle as exp; in units of one it is not."""
    loss = lambda x: jnp.exp(x[0]) + jnp.exp(1e-3 * x[1])
    report = check_gradient(
        loss, jnp.array([0.2, 300.0]), ("a", "b"), scale=jnp.array([1.0, 1e3])
    )
    np.testing.assert_allclose(
        report.gradient, [np.exp(0.2), 1e-3 * np.exp(0.3)], rtol=1e-12
    )
    expected = np.sinh(0.1) / 0.1
    np.testing.assert_allclose(report.prediction[-1], expected, rtol=1e-9)
    assert report.norms[0] == pytest.approx(np.hypot(np.exp(0.2), np.exp(0.3)))


def test_the_loss_is_traced_twice_whatever_the_number_of_points():
    traces = []

    def counted(x):
        traces.append(1)
        return bowl(x)

    check_gradient(counted, START, NAMES, block=7)
    assert len(traces) == 2


def test_reports_are_complete_as_text_and_as_json():
    loss = lambda x: bowl(x) + jnp.where(x[0] < 1.05, 0.0, jnp.nan)
    report = check_gradient(loss, START, NAMES)
    text = render(report)
    lines = text.splitlines()
    for name, verdict in zip(NAMES, report.verdicts, strict=True):
        (line,) = [row for row in lines if row.startswith(name)]
        assert line.endswith(verdict)
    assert lines[-1] == report.verdict
    back = json.loads(json.dumps(to_dict(report), allow_nan=False))
    assert back["names"] == list(NAMES)
    assert back["gradient"] == pytest.approx(report.gradient.tolist())
    assert back["differences"][-1][0] is None
    assert back["verdicts"][NAMES[0]] == {
        "kind": "trust",
        "text": "trust: up to steps of 1 %",
    }
    assert back["verdict"]["text"] == report.verdict


def test_arguments_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="a name for each number"):
        check_gradient(bowl, START, NAMES[:2])
    with pytest.raises(ValueError, match="steps must be two or more"):
        check_gradient(bowl, START, NAMES, steps=(1e-1,))
    with pytest.raises(ValueError, match=r"the largest at least 0\.01"):
        check_gradient(bowl, START, NAMES, steps=(1e-5, 1e-3))
    with pytest.raises(ValueError, match="relative_tolerance must be positive"):
        check_gradient(bowl, START, NAMES, relative_tolerance=0.0)


def test_growth_with_the_horizon_is_measured():
    x = jnp.array([0.1])
    grows = {t: (lambda x, t=t: jnp.exp(t * x[0])) for t in (100.0, 25.0, 50.0)}
    wild = compare_horizons(grows, x)
    np.testing.assert_allclose(wild.at, [25.0, 50.0, 100.0])
    np.testing.assert_allclose(wild.norms, wild.at * np.exp(0.1 * wild.at), rtol=1e-12)
    assert "it explodes" in wild.verdict
    settles = {t: (lambda x, t=t: jnp.exp(-x[0]) / t) for t in (25.0, 50.0)}
    calm = compare_horizons(settles, x)
    assert calm.verdict == "0.5 times the gradient on 2 times the horizon: bounded"
    failed = compare_horizons({1.0: lambda x: x[0], 2.0: lambda x: x[0] * jnp.nan}, x)
    assert "not finite" in failed.verdict
    assert comparison_to_dict(failed)["values"] == [0.1, None]
    assert len(render_comparison(wild).splitlines()) == 5


def test_sensitivity_to_the_smoothing_width_is_measured():
    x = jnp.array([0.5, 0.2])
    loss = lambda x, d: jnp.sqrt(x[0] ** 2 + d * d) + 3.0 * x[1]
    widths = (1e-2, 1e-4, 1e-3)
    calm = compare_smoothing(loss, widths, x)
    np.testing.assert_allclose(calm.at, sorted(widths))
    np.testing.assert_allclose(
        calm.gradients[:, 0], 0.5 / np.hypot(0.5, calm.at), rtol=1e-12
    )
    assert calm.verdict.endswith("insensitive")
    turning = lambda x, d: 5.0 + jnp.sin(x[0] / d)
    sensitive = compare_smoothing(turning, (0.1, 0.2), x)
    cosines = np.sign(np.cos(0.5 / 0.1) * np.cos(0.5 / 0.2))
    np.testing.assert_allclose(sensitive.alignment, [1.0, cosines])
    assert "depends on the width" in sensitive.verdict


def test_reverse_mode_through_the_closed_loop_is_trusted():
    # The law that compiles fastest: the others' gradients are in test_gradients.
    loop = paper.make_loop("switching", "printed", "smc", duration=20.0)
    sea = loop.scenario.sea(jax.random.key(0))
    channels = ("depth", "pitch", "heading")
    paths = [(gain, channel) for gain in ("c0", "c1") for channel in channels]
    names = [f"controller.{gain}.{channel}" for gain, channel in paths]

    def leaves(at):
        return [getattr(getattr(at.controller, k), c) for k, c in paths]

    def loss(free):
        tried = eqx.tree_at(leaves, loop, list(jnp.exp(free)))
        c = evaluate(tried, sea).channels
        return c.depth.rms_error + c.pitch.rms_error + c.heading.rms_error

    start = jnp.log(jnp.stack(leaves(loop)))
    report = check_gradient(loss, start, names, copies=2)
    assert report.kinds == (Kind.TRUST,) * 6, render(report)
    assert np.all(report.error < 1e-6)
    np.testing.assert_allclose(
        report.differences[4], report.gradient, rtol=1e-2, atol=1e-6
    )
