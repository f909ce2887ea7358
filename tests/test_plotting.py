"""Figures, checked by what their axes hold."""

import io

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib._pylab_helpers import Gcf
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from jaxglider import paper, plotting
from jaxglider.control.prescribed.funnel import Limits
from jaxglider.control.prescribed.performance import (
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.plotting.save import save
from jaxglider.plotting.series import MAX_POINTS, break_jumps, keep_extremes
from jaxglider.plotting.style import (
    label_time,
    legend_above,
    look,
    new_figure,
    styles,
)
from jaxglider.signals import BodyAxes, Channels, Command, GliderState, map_fields
from jaxglider.simulation.metrics import empty_sums, finish
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

DT = 0.05


def tick_at(number, active_until, error_scale, bound):
    t = number * DT
    reference = Channels(0.1 * t, -0.7 + 0.01 * t, 0.5 + 0.002 * t)
    error = Channels(*(error_scale * s * jnp.cos(t) for s in (0.2, 0.1, -0.3)))
    turns = 10 * 2 * jnp.pi
    state = GliderState(
        north=0.3 * t,
        east=3.0 - 0.1 * t,
        depth=reference.depth + error.depth,
        roll=0.1 * t,
        pitch=reference.pitch + error.pitch,
        heading=reference.heading + error.heading + turns,
        surge=0.3 + 0.01 * t,
        sway=0.02 * jnp.sin(t),
        heave=0.05 + 0.0 * t,
        roll_rate=0.1 + 0.0 * t,
        pitch_rate=0.01 * t,
        yaw_rate=-0.02 * t,
    )
    falling = bound * (1.0 + jnp.exp(-t))
    edges = Limits(-0.5 * falling, falling)
    applied = Command(*(c * jnp.sin(t) for c in (0.4, 0.06, jnp.pi / 2)))
    zero = 0.0 * t
    return TickRecord(
        time=t,
        active=number < active_until,
        state=state,
        reference=reference,
        error=error,
        limits=Channels(edges, edges, edges),
        law_limits=Channels(edges, edges, edges),
        surface=Channels(zero, zero, zero),
        wanted=map_fields(lambda u: 1e9 * u, applied),
        applied=applied,
        estimate=BodyAxes(*(k * jnp.sin(t) for k in range(1, 7))),
        lumped=BodyAxes(*(k * jnp.cos(t) for k in range(1, 7))),
        disturbance=BodyAxes(*(zero,) * 6),
        target=number * 0,
        clock=t,
    )


ticks_at = jax.jit(jax.vmap(tick_at, (0, None, None, None)))


def make_run(ticks=100, active_until=None, error_scale=1.0, bound=1.0):
    until = ticks if active_until is None else active_until
    records = ticks_at(jnp.arange(ticks), until, error_scale, bound)
    zero = jnp.zeros(())
    metrics = finish(empty_sums(zero), GliderState.at_rest(), jnp.asarray(0), zero + DT)
    return Trajectory(records, metrics)


def spoil(run, first):
    """The run, everything but time and activity NaN from a tick on."""

    def lose(x):
        after = np.arange(len(x)) >= first
        known = jnp.issubdtype(x.dtype, jnp.floating)
        return jnp.asarray(np.where(after, np.nan, x)) if known else x

    lost = jax.tree.map(lose, run.ticks)
    ticks = eqx.tree_at(lambda t: t.time, lost, run.ticks.time)
    return Trajectory(ticks, run.metrics)


def panels(rows, columns=1):
    return Figure(layout="constrained").subplots(rows, columns, squeeze=False).ravel()


def line_of(axis, label):
    (line,) = [x for x in axis.lines if x.get_label() == label]
    return line


def rendered(figure):
    FigureCanvasAgg(figure)
    figure.savefig(io.BytesIO(), format="png", dpi=40)


@pytest.fixture(scope="module")
def run():
    return make_run()


@pytest.fixture(scope="module")
def path():
    return paper.reference("waypoints")


def test_tracking_draws_depth_downward_and_angles_in_degrees(run):
    axes = panels(3)
    assert plotting.tracking(axes, {"SMC": run}) is axes
    assert axes[0].yaxis_inverted()
    assert not axes[1].yaxis_inverted()
    state, reference = run.ticks.state, run.ticks.reference
    np.testing.assert_allclose(line_of(axes[0], "SMC").get_ydata(), state.depth)
    np.testing.assert_allclose(
        line_of(axes[1], "SMC").get_ydata(), np.asarray(state.pitch) * 180 / np.pi
    )
    dashed = [x for x in axes[1].lines if x.get_linestyle() == "--"]
    np.testing.assert_allclose(
        dashed[0].get_ydata(), np.asarray(reference.pitch) * 180 / np.pi
    )
    assert "deg" in axes[1].get_ylabel()
    assert "deg" in axes[2].get_ylabel()
    assert axes[2].get_xlabel() == "time (s)"


@pytest.mark.parametrize(
    ("end", "label", "step"), [(1800.0, "time (s)", 1.0), (9000.0, "time (h)", 3600.0)]
)
def test_long_runs_have_hours_on_their_axis_and_seconds_in_their_lines(
    end, label, step
):
    axes = list(panels(2))
    for axis in axes:
        axis.plot([0.0, end], [0.0, 1.0])
    label_time(axes, end)
    rendered(axes[0].figure)
    low, high = axes[1].get_xlim()
    assert (low, high) == (0.0, end)
    assert [axes[0].get_xlabel(), axes[1].get_xlabel()] == ["", label]
    shown = [
        (text.get_text(), place)
        for text, place in zip(
            axes[1].get_xticklabels(), axes[1].get_xticks(), strict=True
        )
        if low <= place <= high
    ]
    assert 3 < len(shown) < 12
    for text, place in shown:
        assert float(text) * step == pytest.approx(place)


def test_heading_of_a_glider_that_turned_ten_times_stays_near_its_reference(run):
    axes = panels(3)
    plotting.tracking(axes, {"SMC": run})
    expected = np.degrees(np.asarray(run.ticks.state.heading)) - 3600.0
    np.testing.assert_allclose(line_of(axes[2], "SMC").get_ydata(), expected, atol=1e-9)


def test_a_wrapped_angle_is_not_joined_across_its_jump():
    time, angle = break_jumps(np.arange(4.0), np.array([170, 179, -179, -170.0]), 180.0)
    np.testing.assert_array_equal(time, [0, 1, 2, 2, 3])
    np.testing.assert_array_equal(angle, [170, 179, np.nan, -179, -170])


def test_another_reference_is_drawn_only_where_it_differs():
    same, other = make_run(), make_run()
    away = map_fields(lambda x: x + 0.3, other.ticks.reference)
    moved = eqx.tree_at(lambda r: r.ticks.reference, other, away)
    counts = []
    for first in (same, moved):
        axes = panels(3)
        plotting.tracking(axes, {"PPC": first, "FxTPPC": other})
        counts.append([sum(x.get_linestyle() == "--" for x in a.lines) for a in axes])
    # The paper's PPC has a dash pattern of its own, which also reads "--".
    assert [b - a for a, b in zip(*counts, strict=True)] == [1, 1, 1]


def test_errors_lie_in_the_shaded_funnel_of_the_chosen_run():
    narrow, wide = make_run(bound=0.4), make_run(bound=1.0)
    axes = panels(3)
    plotting.errors(axes, {"PPC": narrow, "FxTPPC": wide})
    for axis, scale in zip(axes, (1.0, 180 / np.pi, 180 / np.pi), strict=True):
        (band,) = [c for c in axis.collections if isinstance(c, PolyCollection)]
        corners = band.get_paths()[0].vertices
        edges = wide.ticks.limits.depth
        assert corners[:, 1].max() == pytest.approx(scale * edges.upper.max())
        assert corners[:, 1].min() == pytest.approx(scale * edges.lower.min())
        dotted = [x for x in axis.lines if x.get_linestyle() == ":"]
        assert {to_hex(x.get_color()) for x in dotted} == {
            to_hex(styles(["PPC"])["PPC"].colour)
        }
        drawn = sorted((x.get_ydata() for x in dotted), key=np.max)
        own = narrow.ticks.limits.depth
        np.testing.assert_allclose(drawn[0], scale * np.asarray(own.lower))
        np.testing.assert_allclose(drawn[1], scale * np.asarray(own.upper))
    np.testing.assert_allclose(
        line_of(axes[2], "PPC").get_ydata(),
        np.degrees(np.asarray(narrow.ticks.error.heading)),
    )


def test_a_run_far_outside_its_funnel_is_cut_and_named():
    axes = panels(3)
    plotting.errors(axes, {"SMC": make_run(error_scale=50.0), "PPC": make_run()})
    np.testing.assert_allclose(axes[0].get_ylim(), (-2.8, 2.8))
    assert "SMC 10" in axes[0].get_title(loc="right")
    assert "PPC" not in axes[0].get_title(loc="right")
    axes = panels(3)
    plotting.errors(axes, {"PPC": make_run()})
    assert axes[0].get_title(loc="right") == ""


def test_a_run_without_a_funnel_gets_no_band():
    free = make_run(bound=np.inf)
    axes = panels(3)
    plotting.errors(axes, {"free": free})
    assert not axes[0].collections
    assert [h.get_text() for h in axes[0].get_legend().get_texts()] == ["free"]


def test_command_axes_end_beyond_the_saturation_lines(run):
    actuators = paper.make_scenario().actuators
    axes = panels(3)
    plotting.commands(axes, {"PPC": run}, actuators)
    applied = run.ticks.applied
    truth = (
        np.asarray(applied.buoyancy_mass),
        np.asarray(applied.mass_position),
        np.asarray(applied.mass_angle) * 180 / np.pi,
    )
    for axis, limit, held in zip(axes, (0.4, 0.06, 90.0), truth, strict=True):
        level = [x.get_ydata()[0] for x in axis.lines if len(x.get_ydata()) == 2]
        assert sorted(level) == pytest.approx([-limit, limit])
        assert axis.get_ylim() == pytest.approx((-1.15 * limit, 1.15 * limit))
        np.testing.assert_allclose(line_of(axis, "PPC").get_ydata(), held)
        (wanted,) = [x for x in axis.lines if x.get_alpha() is not None]
        assert np.abs(wanted.get_ydata()).max() == pytest.approx(2 * limit)
    rendered(axes[0].figure)


def test_ticks_after_the_mission_are_not_drawn(path):
    done = make_run(active_until=40)
    last = 39 * DT
    stacked = panels(9)
    plotting.tracking(stacked[:3], {"PPC": done})
    plotting.errors(stacked[3:6], {"PPC": done})
    plotting.commands(stacked[6:], {"PPC": done}, paper.make_scenario().actuators)
    sheet, six = panels(5, 3), panels(2, 3)
    plotting.vehicle_state(sheet, done)
    plotting.disturbance_estimate(six, done)
    for axis in (*stacked, *sheet, *six):
        ends = [x.get_xdata()[-1] for x in axis.lines if len(x.get_xdata()) > 2]
        assert ends
        assert max(ends) == pytest.approx(last)
    plan = panels(1)[0]
    plotting.path_plan(plan, {"PPC": done}, path)
    way = max(plan.lines, key=lambda x: len(x.get_xdata()))
    assert way.get_ydata().max() == pytest.approx(0.3 * last)


def test_disturbance_estimate_is_drawn_against_the_lumped_truth(run):
    axes = panels(2, 3)
    plotting.disturbance_estimate(axes, run, "PPC")
    for k, axis in enumerate(axes, start=1):
        t = np.asarray(run.ticks.time)
        np.testing.assert_allclose(axis.lines[0].get_ydata(), k * np.sin(t))
        np.testing.assert_allclose(axis.lines[1].get_ydata(), k * np.cos(t))


def test_short_peaks_leave_the_scale_with_a_note(run):
    peak = run.ticks.lumped.sway.at[50].set(-400.0)
    spiked = eqx.tree_at(lambda r: r.ticks.lumped.sway, run, peak)
    axes = panels(2, 3)
    plotting.disturbance_estimate(axes, spiked)
    assert "−400" in axes[1].get_title(loc="right")
    assert axes[1].get_ylim()[0] > -10.0
    assert axes[0].get_title(loc="right") == ""


def test_plan_shows_each_waypoint_with_its_switching_circle(run, path):
    axis = panels(1)[0]
    assert plotting.path_plan(axis, {"SMC": run}, path) is axis
    circles = [p for p in axis.patches if isinstance(p, Circle)]
    centres = [c.get_center() for c in circles]
    np.testing.assert_allclose(
        centres, [(5, 10), (-10, 15), (-15, 30), (-5, 50), (10, 50)]
    )
    assert [c.radius for c in circles] == [5.0] * 5
    assert axis.get_aspect() == 1.0
    start = [x for x in axis.lines if x.get_marker() == "o"]
    assert [(x.get_xdata()[0], x.get_ydata()[0]) for x in start] == [(3.0, 0.0)]
    way = max(axis.lines, key=lambda x: len(x.get_xdata()))
    np.testing.assert_allclose(way.get_xdata(), run.ticks.state.east)
    np.testing.assert_allclose(way.get_ydata(), run.ticks.state.north)


def test_plan_without_waypoints_has_no_circles(run):
    axis = panels(1)[0]
    plotting.path_plan(axis, {"SMC": run})
    assert not axis.patches


def test_path_in_space_goes_down_on_one_horizontal_scale(run, path):
    axis = Figure().add_subplot(projection="3d")
    plotting.path_3d(axis, {"SMC": run}, path)
    low, high = axis.get_zlim()
    assert low > high
    box = axis._box_aspect
    widths = np.ptp(axis.get_xlim()), np.ptp(axis.get_ylim())
    assert widths[0] / widths[1] == pytest.approx(box[0] / box[1])
    rings = [x for x in axis.lines if len(x.get_data_3d()[0]) == 73]
    assert len(rings) == 5
    east, north, depth = rings[0].get_data_3d()
    np.testing.assert_allclose(np.hypot(east - 5, north - 10), 5.0)
    np.testing.assert_allclose(depth, 0.0)


def test_state_sheet_holds_speed_and_flow_angles(run):
    axes = panels(5, 3)
    plotting.vehicle_state(axes, run)
    s = run.ticks.state
    u, v, w = (np.asarray(x) for x in (s.surge, s.sway, s.heave))
    speed = np.linalg.norm([u, v, w], axis=0)
    expected = {
        "depth": s.depth,
        "roll φ": np.asarray(s.roll) * 180 / np.pi,
        "yaw rate": np.asarray(s.yaw_rate) * 180 / np.pi,
        "speed": speed,
        "attack": np.arctan(w / u) * 180 / np.pi,
        "sideslip": np.arctan(v / np.hypot(u, w)) * 180 / np.pi,
    }
    for word, values in expected.items():
        (axis,) = [a for a in axes if word in a.get_title()]
        np.testing.assert_allclose(axis.lines[0].get_ydata(), values, atol=1e-12)
        assert axis.yaxis_inverted() == (word == "depth")


def test_performance_functions_fall_from_one_to_zero_in_their_own_time():
    axis = panels(1)[0]
    functions = {
        "sech": SechFunction(1.2, 0.2, 100.0),
        "half": HalfSechFunction(0.9, 0.4, 60.0),
        "exp": ExponentialFunction(1.5, 0.1, 80.0),
    }
    assert plotting.performance_functions(axis, functions, 120.0) is axis

    def sech(x):
        return 1.0 / np.cosh(x)

    shapes = {
        "sech": (100.0, lambda t, z: sech(sech(1.2) * z) / sech(sech(1.2))),
        "half": (60.0, lambda t, z: sech(0.9 * z) / sech(0.9)),
        "exp": (80.0, lambda t, z: (1.5 - t / 80.0) * np.exp(1.0 - z) / 1.5),
    }
    dots = [x.get_xdata()[0] for x in axis.lines if x.get_marker() == "o"]
    for (label, (end, shape)), dot in zip(shapes.items(), dots, strict=True):
        time, share = line_of(axis, label).get_data()
        falling = time < 0.98 * end
        t = time[falling]
        np.testing.assert_allclose(
            share[falling], shape(t, end / (end - t)), atol=1e-10
        )
        assert np.all(share[time >= end] == 0.0)
        assert share[0] == pytest.approx(1.0)
        assert 0.0 <= dot - end < 0.5


def test_thinning_keeps_peaks_ends_and_gaps():
    rng = np.random.default_rng(0)
    values = rng.normal(size=24_000)
    values[[7_777, 15_001]] = 60.0, -70.0
    values[9_000:9_003] = np.nan
    kept = keep_extremes(values)
    assert len(kept) <= MAX_POINTS
    assert {0, 7_777, 15_001, 23_999} <= set(kept.tolist())
    assert np.isnan(values[kept]).any()
    for part in np.array_split(np.arange(24_000), 100):
        inside = values[kept[(kept >= part[0]) & (kept <= part[-1])]]
        assert np.nanmax(inside) >= np.nanquantile(values[part], 0.99)
    np.testing.assert_array_equal(keep_extremes(values[:50]), np.arange(50))


def test_a_long_run_is_drawn_with_few_points_and_its_largest_error():
    long = make_run(ticks=20_000)
    error = np.asarray(long.ticks.error.depth)
    axes = panels(3)
    plotting.errors(axes, {"PPC": long})
    drawn = line_of(axes[0], "PPC").get_ydata()
    assert len(drawn) <= MAX_POINTS
    assert drawn.max() == error.max()
    assert drawn.min() == error.min()


def test_a_label_has_one_colour_whatever_it_is_compared_with():
    alone, among = styles(["FxTPPC"]), styles(["mine", "SMC", "FxTPPC", "yours"])
    assert alone["FxTPPC"] == among["FxTPPC"]
    assert len({s.colour for s in among.values()}) == 4
    assert len({str(s.dashes) for s in among.values()}) == 4


def test_a_run_that_stops_being_finite_ends_in_a_cross(run):
    lost = spoil(run, 60)
    axes = panels(3)
    plotting.tracking(axes, {"PPC": lost})
    crosses = [x for x in axes[0].lines if x.get_marker() == "x"]
    assert {x.get_xdata()[0] for x in crosses} == {59 * DT}
    assert {x.get_ydata()[0] for x in crosses} >= {run.ticks.state.depth[59].item()}


def test_runs_that_are_not_finite_do_not_stop_the_figures(run):
    runs = {"SMC": spoil(run, 0), "PPC": spoil(run, 60), "FxTPPC": run}
    names = []
    for name, figure in plotting.figures(paper.make_scenario("waypoints"), runs):
        rendered(figure)
        names.append(name)
    assert "vehicle_state_ppc" in names
    assert "disturbance_estimate_fxtppc" in names
    assert not [n for n in names if n.endswith("smc")]


def test_huge_finite_numbers_do_not_stop_the_figures(run):
    far = map_fields(lambda x: x.at[50:].set(1e300), run.ticks.state)
    huge = eqx.tree_at(lambda r: r.ticks.state, run, far)
    axes = panels(5, 3)
    plotting.vehicle_state(axes, huge)
    rendered(axes[0].figure)
    assert axes[0].get_ylim()[1] < 1e3


@pytest.mark.parametrize("three", ["tracking", "errors"])
def test_wrong_axes_or_labels_are_refused(run, three):
    draw = getattr(plotting, three)
    with pytest.raises(ValueError, match="needs 3 axes; received 2"):
        draw(panels(2), {"SMC": run})
    with pytest.raises(ValueError, match="one of SMC; received 'PPC'"):
        draw(panels(3), {"SMC": run}, "PPC")
    with pytest.raises(ValueError, match="at least one trajectory"):
        draw(panels(3), {})


@pytest.fixture(scope="module")
def written(tmp_path_factory, simulate_jit):
    """A real run, its files, and what was in the folder before."""
    folder = tmp_path_factory.mktemp("figures")
    (folder / "tracking.png").write_bytes(b"old")
    loop = paper.make_loop("waypoints", duration=20.0)
    real = simulate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    before = dict(matplotlib.rcParams)
    files = plotting.save_all(folder, loop.scenario, {"FxTPPC": real})
    return folder, files, before


def test_all_figures_are_written_and_nothing_is_left_over(written):
    folder, files, _ = written
    names = {
        "performance_functions",
        "tracking",
        "errors",
        "commands",
        "path_3d",
        "path_plan",
        "depth_over_distance",
        "vehicle_state_fxtppc",
        "disturbance_estimate_fxtppc",
    }
    assert {f.name for f in folder.iterdir()} == {f"{name}.png" for name in names}
    assert set(files) == set(folder.iterdir())
    for file in files:
        assert file.read_bytes().startswith(b"\x89PNG")


def test_drawing_leaves_no_global_state(written):
    assert dict(matplotlib.rcParams) == written[2]
    assert not Gcf.figs


def test_a_failed_write_keeps_the_old_file(tmp_path):
    class Broken(Figure):
        def savefig(self, target, **options):
            target.write_bytes(b"half")
            raise OSError("disk full")

    old = tmp_path / "tracking.png"
    old.write_bytes(b"old")
    with pytest.raises(OSError, match="disk full"):
        save(Broken(), old)
    assert [f.name for f in tmp_path.iterdir()] == ["tracking.png"]
    assert old.read_bytes() == b"old"


def test_each_format_is_written_as_such(tmp_path):
    figure = Figure()
    for ending, magic in (("pdf", b"%PDF"), ("svg", b"<?xml")):
        assert save(figure, tmp_path / f"x.{ending}").read_bytes().startswith(magic)


@pytest.fixture(scope="module")
def every(run):
    """All figures of three runs."""
    runs = {label: make_run(bound=b) for label, b in (("SMC", 1), ("PPC", 2))}
    runs["FxTPPC"] = run
    return dict(plotting.figures(paper.make_scenario("waypoints"), runs))


@pytest.mark.parametrize("name", ["tracking", "errors", "commands", "path_plan"])
def test_legend_is_legible_and_covers_neither_data_nor_margin(every, name):
    figure = every[name]
    with look():
        figure.canvas.draw()
    axis = figure.axes[0]
    box = axis.get_legend().get_window_extent()
    assert not any(box.overlaps(a.get_window_extent()) for a in figure.axes)
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert box.y1 <= figure.bbox.y1 + 0.5
    assert axis.get_window_extent().width > 0.6 * figure.bbox.width
    texts = [*axis.get_legend().get_texts(), axis.yaxis.label, *axis.get_xticklabels()]
    assert min(t.get_fontsize() for t in texts) >= 8.0


def test_panels_keep_their_height_under_the_legend_of_many_runs():
    heights = []
    for count in (3, 18):
        with look():
            figure = new_figure(3.4, 4.2)
            panels = figure.subplots(3, 1)
            names = [f"fixed-time-backstepping ({n})" for n in range(count)]
            legend_above(panels[0], [Line2D([], [], label=name) for name in names])
            figure.draw_without_rendering()
        heights.append(panels[0].get_position().height * figure.get_figheight())
    assert heights[1] > 0.6 * heights[0]
