"""Reverse mode against central differences, for every float that can be tuned.

120 s of the closed loop in double precision, from the paper's gains: until after the
last funnel has settled. The differences are taken in relative steps of several sizes,
second and fourth order; each float may pick its best one: a small sensitivity needs a
large step, a large one a small step.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from jaxglider import Calm, RollAwareFxTPPC, map_members, paper
from jaxglider.control import AbstractController, ControlRecord, tracking_error
from jaxglider.control.observer import NoObserver
from jaxglider.core.differentiation import value_and_gradient
from jaxglider.signals import BodyAxes, Channels, Command, map_fields, zeros
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import finish
from jaxglider.simulation.rollout import evaluate, sparse_checkpoints
from jaxglider.vehicle.parameters import GliderParameters
from jaxglider.vehicle.plant import AbstractPlant

STEPS = (1e-4, 1e-5, 1e-3, 1e-6)
RUNS = 64
"""Runs at once: differences of 32 floats to second order, or of 16 to fourth."""
TOLERANCE = 1e-5
FLOOR = 1e-10
"""Below this, relative to the objective of about 5, differences are rounding."""


def _heading(loop):
    return loop.scenario.initial_state.heading


def _parts(loop):
    scenario = loop.scenario
    return (
        *(loop.controller, loop.observer, scenario.plant),
        *(_guidance(loop), _heading(loop)),
    )


def _guidance(loop):
    reference = loop.scenario.reference
    if hasattr(reference, "line_of_sight"):
        return (reference.line_of_sight, reference.north, reference.east)
    schedule = reference.schedule
    return (schedule.gliding_angle, schedule.heading, schedule.depth_rate)


def _names(parts):
    leaves = jax.tree_util.tree_leaves_with_path(parts)
    return [jax.tree_util.keystr(path) for path, x in leaves for _ in range(np.size(x))]


def _objective(loop, sea, **options):
    start, rebuild = ravel_pytree(_parts(loop))

    def loss(flat):
        changed = eqx.tree_at(
            lambda at: jax.tree.leaves(_parts(at)), loop, jax.tree.leaves(rebuild(flat))
        )
        c = evaluate(changed, sea, **options).channels
        return (
            c.depth.rms_error / 0.12
            + c.pitch.rms_error / 0.05
            + c.heading.rms_error / 0.2
        )

    return start, loss


@pytest.fixture(scope="module")
def proposed():
    """A loop of the proposed law, its start, objective, and the latter's reverse mode.

    Each is compiled once, for all tests that ask for it.
    """

    @functools.cache
    def make(scenario, plant):
        loop = paper.make_loop(
            scenario,
            plant,
            duration=120.0,
            steering=paper.INVERSION,
            actuators="ideal",
        )
        if plant == "rigid-body":
            aware = RollAwareFxTPPC(loop.controller, 0.01, 0.3, 1.0, 0.1)
            loop = dataclasses.replace(loop, controller=aware)
        start, loss = _objective(loop, loop.scenario.sea(jax.random.key(0)))
        return loop, start, loss, jax.jit(jax.value_and_grad(loss))

    return make


def _blocks(numbers, length):
    """The numbers in blocks of one length, the last filled up with its first."""
    for n in range(0, len(numbers), length):
        block = numbers[n : n + length]
        yield np.append(block, np.full(length - len(block), block[0]))


# Each scenario and each of the two plants once, so every float of each is covered; the
# two others would pair the same formulas anew.
@pytest.mark.parametrize(
    ("scenario", "plant"), [("switching", "rigid-body"), ("waypoints", "printed")]
)
def test_every_gain_and_parameter_agrees_with_central_differences(
    proposed, scenario, plant
):
    loop, start, loss, both = proposed(scenario, plant)
    value, gradient = both(start)
    scale = np.where(np.asarray(start) != 0.0, np.abs(start), 1.0)
    allowed = TOLERANCE * np.abs(gradient) * scale + FLOOR * float(value)
    batch = jax.jit(lambda points: map_members(loss, points))
    error = np.full(start.size, np.inf)
    slopes = np.asarray(gradient) * scale
    # The next order and size only for those that no earlier one was right for.
    for h, order in [(STEPS[0], 2), *((h, 4) for h in STEPS)]:
        for block in _blocks(np.flatnonzero(error > allowed), RUNS // order):
            shift = h * scale[block, None] * np.eye(start.size)[block]
            points = [start + n * shift for n in (1, -1, 2, -2)[:order]]
            found = np.split(np.asarray(batch(jnp.concatenate(points))), order)
            differences = [(found[0] - found[1]) / (2 * h)]
            if order == 4:
                wide = (found[2] - found[3]) / (4 * h)
                differences.append((4 * differences[0] - wide) / 3)
            least = np.abs(np.stack(differences) - slopes[block]).min(axis=0)
            error[block] = np.minimum(error[block], least)
    names = _names(_parts(loop))
    bad = [f"{names[i]}: {error[i]:.1e}" for i in np.flatnonzero(error > allowed)]
    assert not bad, bad
    assert np.count_nonzero(np.abs(gradient) * scale > 1e-6) > 60


@pytest.fixture(scope="module")
def baselines():
    """A short loop of each baseline, its sea, start, objective, and both at once."""

    def make(controller):
        loop = paper.make_loop("switching", "printed", controller, duration=20.0)
        sea = loop.scenario.sea(jax.random.key(0))
        start, loss = _objective(loop, sea)
        return loop, sea, start, loss, jax.jit(value_and_gradient(loss, "reverse"))

    return {name: make(name) for name in ("smc", "ppc")}


@pytest.mark.parametrize("controller", ["smc", "ppc"])
def test_baselines_agree_with_a_directional_difference(baselines, controller):
    *_, start, _, both = baselines[controller]
    direction = jax.random.normal(jax.random.key(1), start.shape) * jnp.abs(start)
    slope = jnp.vdot(both(start)[1], direction)
    value = lambda t: both(start + t * direction)[0]
    errors = []
    for h in (1e-4, 1e-5, 1e-6):
        difference = (value(h) - value(-h)) / (2 * h)
        errors.append(abs(float(difference / slope) - 1.0))
    assert min(errors) < TOLERANCE


def test_gradient_is_exact_where_the_error_starts_at_zero_and_at_the_funnel_edge(
    proposed,
):
    """Depth starts at zero error; heading is put on the 95 % edge of its funnel."""
    loop, start, _, both = proposed("switching", "rigid-body")
    controller, *_, at_start = ravel_pytree(_parts(loop))[1](
        jnp.arange(float(start.size))
    )
    heading, k1 = int(at_start), int(controller.law.gains.heading.k1)
    bounds = loop.controller.bounds(jnp.asarray(0.0))
    edge = 0.95 * float(bounds.heading.value)
    on_edge = float(loop.scenario.reference.schedule.heading[0]) - edge

    # On the edge itself the second derivative of the transformation jumps, so the
    # start is differentiated just inside of it and just outside.
    for aside in (1e-4, -1e-4):
        at = start.at[heading].set(on_edge + aside)
        slopes = both(at)[1]
        for number, h in ((heading, 1e-6), (k1, 1e-8)):
            plus, minus = (both(at.at[number].add(step))[0] for step in (h, -h))
            difference = (plus - minus) / (2 * h)
            np.testing.assert_allclose(slopes[number], difference, rtol=1e-5)


def test_forward_and_reverse_mode_agree_and_auto_is_one_of_them(baselines):
    *_, start, loss, both = baselines["smc"]
    again, reverse = both(start)
    value, forward = jax.jit(value_and_gradient(loss, "forward"))(start)
    assert float(value) == pytest.approx(float(again), rel=1e-13)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-9 * float(value))
    assert np.count_nonzero(reverse) > 20
    with pytest.raises(ValueError, match="auto, forward, reverse; received 'sideways'"):
        value_and_gradient(loss, "sideways")


@pytest.mark.parametrize(("members", "mode"), [(1, "forward"), (2, "reverse")])
def test_the_mode_follows_from_the_lanes_it_would_fill(members, mode):
    """Three tangents and a value: four lanes for one member, eight for two."""
    cube = lambda x: jnp.sum(x**3)
    x = jnp.arange(6.0 if members == 1 else 7.0)
    jaxpr = str(jax.make_jaxpr(value_and_gradient(cube, members=members))(x))
    one = str(jax.make_jaxpr(value_and_gradient(cube, mode))(x))
    assert jaxpr == one


class Swing(AbstractPlant):
    """A glider that only swings in pitch and otherwise comes to rest."""

    parameters: GliderParameters

    def derivative(self, state, command, disturbance):
        rates = map_fields(lambda x: -0.1 * jnp.sin(x), state)
        push = command.mass_position + disturbance.pitch - jnp.sin(state.pitch)
        return dataclasses.replace(rates, pitch=state.pitch_rate, pitch_rate=push)

    def water(self, velocity):
        raise NotImplementedError

    def model(self):
        raise NotImplementedError


class Proportional(AbstractController):
    gains: Channels
    model: None = None
    funnel: None = None

    def init(self):
        return None

    def step(self, state, measurement, reference, bounds, dt):
        error, _ = tracking_error(measurement, reference)
        wanted = map_fields(lambda k, e: -k * e, self.gains, error)
        return Command(*vars(wanted).values()), state, ControlRecord(error, error)


def _swinging(ticks):
    """A loop of few operations: the scan around it is what is looked at."""
    scenario = paper.make_scenario("switching", duration=0.05 * ticks)
    plant = Swing(scenario.plant.parameters)
    gains = Channels(*map(jnp.asarray, (0.1, 0.02, 0.3)))
    return ClosedLoop(
        dataclasses.replace(scenario, plant=plant), Proportional(gains), NoObserver()
    )


class Integrating(Proportional):
    """It sums errors up, and takes the estimated moment for one more."""

    def init(self):
        return zeros(Channels)

    def step(self, state, measurement, reference, bounds, dt):
        error, _ = tracking_error(measurement, reference)
        total = map_fields(lambda s, e: s + dt * e, state, error)
        felt = dataclasses.replace(
            error, pitch=error.pitch + measurement.disturbance.pitch
        )
        felt = map_fields(lambda e, s: e + 0.1 * s, felt, total)
        wanted = map_fields(lambda k, e: -k * e, self.gains, felt)
        record = ControlRecord(error, error)
        return Command(*vars(wanted).values()), total, record


class Lagging(NoObserver):
    """An estimate that follows the turn rates, and what is held, with a lag."""

    def step(self, observer_state, measurement, applied, following, dt):
        felt = BodyAxes(*following.velocity().fields()[:5], applied.mass_angle)
        return map_fields(lambda d, x: d + dt * (x - d), observer_state, felt)


def _remembering(ticks):
    """A loop of few operations in which all that can remember does."""
    loop = _swinging(ticks)
    scenario = dataclasses.replace(
        loop.scenario,
        actuators=map_fields(
            lambda a: dataclasses.replace(a, time_constant=0.5),
            loop.scenario.actuators,
        ),
    )
    return ClosedLoop(scenario, Integrating(loop.controller.gains), Lagging())


def test_a_gradient_memory_changes_no_value_and_without_end_no_gradient():
    loop = _remembering(400)
    sea = loop.scenario.sea(jax.random.key(0))

    @jax.jit
    def remembering(memory):
        def loss(gains):
            changed = eqx.tree_at(lambda at: at.controller.gains, loop, rebuild(gains))
            metrics = evaluate(changed, sea, gradient_memory=memory)
            return sum(c.rms_error for c in vars(metrics.channels).values())

        start, rebuild = ravel_pytree(loop.controller.gains)
        return jax.value_and_grad(loss)(start)

    plain = remembering(None)

    value, slope = remembering(jnp.asarray(1e15))
    assert float(value) == pytest.approx(float(plain[0]), rel=1e-13)
    np.testing.assert_allclose(slope, plain[1], rtol=1e-9)
    value, slope = remembering(jnp.asarray(5.0))
    assert float(value) == pytest.approx(float(plain[0]), rel=1e-13)
    assert np.linalg.norm(slope - plain[1]) > 0.05 * np.linalg.norm(plain[1])


def test_a_gradient_memory_fades_the_tangents_from_tick_to_tick():
    """Against tangents pushed forward by hand: t(k+1) = A s t(k) + b, s = e^(-dt/tau).

    A and b are the derivatives of one tick in its carry and in the gain; the sums of
    the metrics add up without fading.
    """
    memory, ticks = 1.0, 40
    loop = _remembering(ticks)
    sea = loop.scenario.sea(jax.random.key(0))
    where = lambda at: at.controller.gains.pitch

    def faded(gain):
        changed = eqx.tree_at(where, loop, gain)
        metrics = evaluate(changed, sea, gradient_memory=memory)
        return metrics.channels.pitch.rms_error

    def tick(gain, carry, number):
        changed = eqx.tree_at(where, loop, gain)
        inputs = jax.tree.map(lambda x: x[number], changed.inputs(sea))
        return changed.tick(carry, inputs)[0]

    @jax.jit
    def push(carry, tangents, number):
        return jax.jvp(
            lambda gain, before: tick(gain, before, number),
            (jnp.asarray(where(loop)), carry),
            (jnp.ones(()), tangents),
        )

    def tangent_of(x):
        whole = not jnp.issubdtype(jnp.result_type(x), jnp.floating)
        return np.zeros(np.shape(x), jax.dtypes.float0) if whole else jnp.zeros_like(x)

    share = np.exp(-float(loop.scenario.clock.dt) / memory)
    fade = lambda t: t if t.dtype == jax.dtypes.float0 else share * t
    carry = loop.init()
    tangents = jax.tree.map(tangent_of, carry)
    for number in range(ticks):
        kept = tangents.sums
        tangents = eqx.tree_at(lambda t: t.sums, jax.tree.map(fade, tangents), kept)
        carry, tangents = push(carry, tangents, number)

    def end(last):
        dt = loop.scenario.clock.dt
        return finish(last.sums, last.state, last.reached, dt).channels.pitch.rms_error

    _, wanted = jax.jvp(end, (carry,), (tangents,))
    assert abs(float(wanted)) > 1e-6
    np.testing.assert_allclose(jax.jit(jax.grad(faded))(where(loop)), wanted, rtol=1e-9)


def test_sparse_checkpoints_change_no_gradient_and_need_less_memory():
    """√n of n states are kept, so four times the ticks need about twice the memory."""
    needed = {}
    for ticks in (400, 1600):
        loop = _swinging(ticks)
        sea = loop.scenario.sea(jax.random.key(0))
        where = lambda at: at.controller.gains

        def error(gains, every, loop=loop, sea=sea, where=where):
            changed = eqx.tree_at(where, loop, gains)
            return evaluate(
                changed, sea, checkpoint_every=every
            ).channels.pitch.rms_error

        for every in (1, sparse_checkpoints(ticks)):
            program = jax.jit(functools.partial(jax.value_and_grad(error), every=every))
            compiled = program.lower(where(loop)).compile()
            memory = compiled.memory_analysis().temp_size_in_bytes
            needed[ticks, every] = memory, ravel_pytree(compiled(where(loop)))[0]
        every = sparse_checkpoints(ticks)
        np.testing.assert_allclose(
            needed[ticks, every][1], needed[ticks, 1][1], rtol=1e-10, atol=1e-14
        )
    assert needed[1600, 1][0] > 3.0 * needed[400, 1][0]
    assert needed[1600, 40][0] < 2.5 * needed[400, 20][0]
    assert needed[1600, 40][0] < 0.2 * needed[1600, 1][0]


def test_checkpoints_divide_the_run():
    assert sparse_checkpoints(16000) in (125, 128)
    assert sparse_checkpoints(7919) in (1, 7919)
    loop = paper.make_loop("switching", controller="smc", duration=1.0)
    sea = loop.scenario.sea(jax.random.key(0))
    for wrong in (0, 3):
        with pytest.raises(ValueError, match=f"divide the 20 ticks; received {wrong}"):
            evaluate(loop, sea, checkpoint_every=wrong)


def test_where_an_error_or_a_command_stays_exactly_zero_gradients_are_right():
    """A straight dive from rest, due north, keeps its heading to the last bit.

    And a glider that is asked for nothing at all has no error in any channel. A root
    mean square has a kink there: its gradient is the middle of the two slopes.
    """
    loop = paper.make_loop(duration=10.0)
    loop = eqx.tree_at(lambda x: x.scenario.disturbance, loop, Calm())
    sea = loop.scenario.sea(jax.random.key(0))
    start, _ = ravel_pytree(loop.controller.gains)
    rebuild = ravel_pytree(loop.controller.gains)[1]
    schedule = lambda x: x.scenario.reference.schedule

    def errors(gains, heading, angle, depth_rate):
        segments = jnp.ones_like(schedule(loop).start)
        changed = eqx.tree_at(
            lambda x: (
                x.controller.gains,
                x.scenario.initial_state.heading,
                schedule(x).gliding_angle,
                schedule(x).depth_rate,
                schedule(x).heading,
            ),
            loop,
            (rebuild(gains), heading, *(segments * v for v in (angle, depth_rate, 0))),
        )
        c = evaluate(changed, sea).channels
        return jnp.stack(
            [
                getattr(getattr(c, channel), measure)
                for channel in ("depth", "pitch", "heading")
                for measure in ("rms_error", "rms_effort", "chattering")
            ]
        )

    h = 1e-5
    cases = [(start, 0.0, -0.6, 0.1), (start, 0.0, 0.0, 0.0)]
    for n in range(start.size):
        step = jnp.zeros_like(start).at[n].set(h * start[n])
        cases += [(start + step, 0.0, -0.6, 0.1), (start - step, 0.0, -0.6, 0.1)]
    cases += [(start, h, -0.6, 0.1), (start, -h, -0.6, 0.1)]
    columns = [jnp.asarray(np.stack(c)) for c in zip(*cases, strict=True)]
    values = jax.jit(jax.vmap(errors))(*columns)
    slopes, by_heading = jax.jit(jax.vmap(jax.jacrev(errors, (0, 1))))(
        *(column[:2] for column in columns)
    )
    np.testing.assert_array_equal(values[0, 6:], 0.0)
    np.testing.assert_array_equal(values[1], 0.0)
    np.testing.assert_array_equal(slopes[1], 0.0)
    plus, minus = values[2:-2:2], values[3:-2:2]
    central = (plus - minus) / (2 * h)
    scaled = np.asarray(slopes[0]).T * np.asarray(start)[:, None]
    np.testing.assert_allclose(scaled, central, rtol=1e-5, atol=1e-9)
    assert np.abs(scaled).max() > 1e-3
    ahead, behind = ((values[i] - values[0])[6:] / h for i in (-2, -1))
    assert np.all(ahead[:2] > 0.1)
    np.testing.assert_allclose(ahead, behind, rtol=1e-6)
    np.testing.assert_allclose(by_heading[0, 6:], 0.5 * (ahead - behind), atol=1e-6)
