"""Every member of every family keeps the same contract, from one line in a registry.

A member is whatever has numbers; `tick(member, carry, given)` uses it once, as a scan
would. The contract: compiled equals eager, lanes equal single calls, the carry keeps
its structure through a scan, gradients are finite, new numbers need no new trace, and
single precision stays single.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.control import AbstractController
from jaxglider.control.catalogue import BY_NAME, OBSERVERS
from jaxglider.control.observer import AbstractObserver
from jaxglider.control.prescribed.performance import (
    AbstractPerformanceFunction,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.environment.disturbances import (
    AbstractDisturbance,
    Calm,
    Constant,
    GaussMarkov,
    ScaledDisturbance,
    Sum,
    axes,
)
from jaxglider.guidance import (
    AbstractReference,
    AttitudeSchedule,
    LineOfSight,
    Schedule,
    WaypointPath,
    Yo,
)
from jaxglider.guidance.phases import HalfYo
from jaxglider.guidance.settings import YoSettings
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    zeros,
)
from jaxglider.simulation.checks.half_yo import HeldHalf
from jaxglider.vehicle.actuators import Actuator, Failure
from jaxglider.vehicle.energy import Pump
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.plant import AbstractPlant, printed_plant, rigid_body_plant
from jaxglider.vehicle.published import load_vehicle

DT = 0.05
PARAMETERS = load_vehicle("seawing").parameters
MODEL = paper.design_model(printed_plant(PARAMETERS))


def numbers(tree):
    return eqx.filter(tree, eqx.is_inexact_array)


def renumbered(tree, factor):
    """The same thing with other numbers."""
    return jax.tree.map(lambda x: x * factor if eqx.is_inexact_array(x) else x, tree)


def single(tree):
    """The same thing in single precision."""
    return jax.tree.map(
        lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, tree
    )


def pick(tree, n):
    return jax.tree.map(lambda x: x[n], tree)


def stack(trees):
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def named_leaves(tree):
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        yield jax.tree_util.keystr(path), leaf


@dataclasses.dataclass
class Case:
    """One member, how it is used, and three inputs (leading axis) to use it on."""

    member: Any
    tick: Callable[[Any, Any, Any], tuple[Any, Any]]
    carry: Any
    inputs: Any
    renumber: Callable[[Any, float], Any] = renumbered


def assert_close(found, expected):
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert a.shape == b.shape
        assert a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def check_contract(case):
    """Assert every clause of the contract."""
    traces = []

    def gradient_of(used):
        floats, rest = eqx.partition(used, eqx.is_inexact_array)

        def score(floats):
            result = case.tick(*eqx.combine(floats, rest))
            return sum(jnp.sum(jnp.sin(x)) for x in leaves(result)), result

        return jax.grad(score, has_aux=True)(floats)

    @jax.jit
    def with_gradient(*used):
        traces.append(None)
        # Twice over in a loop, as in a rollout: without one it compiles slower.
        return pick(jax.lax.map(gradient_of, stack([used, used])), 0)

    def leaves(result):
        return jax.tree.leaves(numbers(result))

    count = 3
    members = [case.renumber(case.member, 1.0 + 0.01 * n) for n in range(count)]
    inputs = [pick(case.inputs, n) for n in range(count)]
    for member, given in zip(members, inputs, strict=True):
        gradient, result = with_gradient(member, case.carry, given)
        for name, leaf in named_leaves(gradient):
            assert np.all(np.isfinite(leaf)), f"gradient{name} is {leaf}"
    assert len(traces) == 1, f"new numbers alone were traced {len(traces)} times"
    assert_close(result, case.tick(member, case.carry, given))
    shapes = jax.eval_shape(case.tick, member, case.carry, given)[0]
    # A loop gives back strong types whatever it is given, so weak ones are looked for.
    for (name, leaf), old in zip(
        named_leaves(shapes), jax.tree.leaves(case.carry), strict=True
    ):
        weak = leaf.weak_type, jax.typeof(old).weak_type
        assert weak[0] == weak[1], f"the carry's {name} would be traced again"

    @jax.jit
    def lanes_in_a_scan(members, carries, inputs):
        tick = jax.vmap(case.tick, axis_size=count)
        return jax.lax.scan(partial(tick, members), carries, inputs)

    # Each lane takes the inputs in another order.
    orders = np.add.outer(np.arange(count), np.arange(count)) % count
    found, outputs = lanes_in_a_scan(
        stack(members), stack([case.carry] * count), pick(case.inputs, orders.T)
    )
    for n, member in enumerate(members):
        carry, outs = case.carry, []
        for step in orders[n]:
            carry, out = with_gradient(member, carry, inputs[step])[1]
            outs.append(out)
        lane = jax.tree.map(lambda x, n=n: x[:, n], outputs)
        assert_close((pick(found, n), lane), (carry, stack(outs)))
    assert len(traces) == 1, "a carry handed back was traced again"

    small = single((case.member, case.carry, inputs[0]))
    for name, leaf in named_leaves(jax.eval_shape(case.tick, *small)):
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            assert leaf.dtype == jnp.float32, f"{name} became {leaf.dtype}"


def state_of(scale):
    """A glider on its way; all zero for scale 0, where formulas have kinks."""
    return GliderState(
        *(
            scale
            * jnp.array([3, 1, 2, 0.1, -0.5, 0.4, 0.4, 0.01, 0.01, 0.01, 0.02, 0.01])
        )
    )


def stacked(build, scales=(0.0, 1.0, -0.7)):
    return stack([build(s) for s in scales])


def command_of(scale):
    return Command(*(scale * jnp.array([0.2, 0.02, 0.4])))


def force_of(scale):
    return BodyAxes(*(scale * jnp.array([0.02, 0.01, -0.02, 0.01, 0.02, -0.01])))


def measurement_of(scale):
    state = state_of(scale)
    return Measurement(state, state.attitude(), command_of(scale), force_of(scale))


def performance(member):
    def tick(member, carry, clock):
        bound = member(clock)
        return carry, (bound.value, bound.rate, bound.acceleration)

    # Settling times are 8 s: before, at and after.
    return Case(member, tick, None, jnp.array([3.0, 8.0, 20.0]))


def disturbance(member):
    def tick(member, carry, given):
        key, start = given
        times = start + DT * jnp.arange(4, dtype=start.dtype)
        return carry, member.realise(key, times)

    return Case(
        member, tick, None, (jr.split(jr.key(0), 3), jnp.array([0.0, 1.0, 7.0]))
    )


def plant(member):
    def tick(member, state, given):
        rate = member.derivative(state, *given)
        return jax.tree.map(lambda x, k: x + DT * k.astype(x.dtype), state, rate), rate

    return Case(
        member, tick, state_of(1.0), stacked(lambda s: (command_of(s), force_of(s)))
    )


def actuator(member):
    def tick(member, held, wanted):
        held = member.follow(held, wanted, jnp.asarray(DT, held.dtype))
        return held, held

    return Case(member, tick, jnp.zeros(()), jnp.array([0.1, 0.9, -0.3]))


def observer(member):
    def tick(member, memory, given):
        measurement, following = given
        dt = jnp.asarray(DT, following.surge.dtype)
        memory = member.step(memory, measurement, measurement.applied, following, dt)
        return memory, member.estimate(memory)

    given = stacked(lambda s: (measurement_of(s), state_of(1.05 * s)))
    return Case(member, tick, member.init(state_of(0.0)), given)


def controller(member):
    def tick(member, memory, given):
        measurement, reference = given
        clock = reference.clock
        command, memory, record = member.step(
            memory,
            measurement,
            reference,
            member.bounds(clock),
            jnp.asarray(DT, clock.dtype),
        )
        return memory, (command, record)

    def given(scale):
        # No error at all for scale 0.
        return measurement_of(scale), Reference(
            Channels(*(0.9 * scale * jnp.array([2.0, -0.5, 0.4]))),
            Channels(*(scale * jnp.array([0.1, 0.0, 0.01]))),
            zeros(Channels),
            jnp.asarray(20.0 + 10.0 * scale),
            jnp.asarray(0, jnp.int32),
            jnp.asarray(False),
        )

    return Case(member, tick, member.init(), stacked(given))


def reference(member):
    def tick(member, memory, given):
        time, measurement = given
        planned = pick(member.plan(time[None]), 0)
        asked, memory = member.step(
            memory, planned, measurement, jnp.asarray(DT, time.dtype)
        )
        return memory, asked

    # The second place is near the first waypoint; the third time in the next segment.
    given = jnp.array([0.0, 1.0, 12.0]), stacked(measurement_of)
    return Case(member, tick, member.init(state_of(0.0)), given)


def rate_limited():
    return Actuator(0.4, rate_limit=0.8, time_constant=0.3)


def failure():
    return Failure(weak_from=0.0, effectiveness=0.5)


def yo():
    halves = HalfYo(-0.4, 0.2, depth_rate=0.1), HalfYo(0.4, -0.2, of_path=True)
    settings = YoSettings(*halves, bottom=40.0, yos=2, duration=900.0)
    return Yo(AttitudeSchedule(schedule()), settings)


def schedule():
    return Schedule([0.0, 10.0], [-0.7, -1.0], [0.5, 0.0], [0.1, 0.2])


REGISTRY = {
    "performance/sech": lambda: performance(SechFunction(1.0, 0.2, 8.0)),
    "performance/half-sech": lambda: performance(HalfSechFunction(1.0, 0.2, 8.0)),
    "performance/exponential": lambda: performance(ExponentialFunction(1.5, 0.2, 8.0)),
    "disturbance/calm": lambda: disturbance(Calm()),
    "disturbance/constant": lambda: disturbance(Constant(force_of(1.0))),
    "disturbance/sinusoid": lambda: disturbance(paper.disturbance()),
    "disturbance/gauss-markov": lambda: disturbance(coloured()),
    "disturbance/sum": lambda: disturbance(Sum((paper.disturbance(), Calm()))),
    "disturbance/varied": lambda: disturbance(
        ScaledDisturbance(paper.disturbance(), 1.3, 0.4)
    ),
    "plant/printed": lambda: plant(printed_plant(PARAMETERS)),
    "plant/rigid-body": lambda: plant(rigid_body_plant(PARAMETERS)),
    "plant/seawing": lambda: plant(full_plant(load_vehicle("seawing"))),
    "actuator/saturated": lambda: actuator(Actuator(0.4)),
    "actuator/rate-limited": lambda: actuator(rate_limited()),
    "actuator/failing": lambda: actuator(Actuator(0.4, failure=failure())),
    "actuator/pump": lambda: actuator(
        Pump(0.4, push_rate=0.9, draw_rate=0.5, boost_rate=0.7)
    ),
    "plant/fin": lambda: plant(full_plant(load_vehicle("slocum-comet"))),
    "reference/yo": lambda: reference(yo()),
    "reference/half-yo": lambda: reference(HeldHalf(yo().course, yo().settings)),
    **{
        f"observer/{name}": lambda name=name: observer(paper.make_observer(name, MODEL))
        for name in OBSERVERS
    },
    **{
        f"controller/{name}": lambda name=name: controller(
            paper.make_controller(name, "switching", MODEL)
        )
        for name in BY_NAME
    },
    "reference/schedule": lambda: reference(AttitudeSchedule(schedule())),
    "reference/waypoints": lambda: reference(
        WaypointPath([4.0, 9.0], [2.0, 0.0], LineOfSight(2.5, 0.01), schedule(), 3.0)
    ),
}


def coloured():
    return GaussMarkov(BodyAxes(*(0.01,) * 6), axes(2.0, 3.0, 4.0, 5.0, 6.0, 7.0))


@pytest.mark.parametrize("name", REGISTRY)
def test_member_keeps_the_contract(name):
    check_contract(REGISTRY[name]())


OUTSIDE = {"PipeController"}
"""Asks another program: neither pure nor for lanes. `test_export_cli` holds it."""


def concrete_members(family):
    """Names of the final classes below an abstract one, in the package."""
    found = set()
    for kind in family.__subclasses__():
        if kind.__module__.startswith("jaxglider."):
            found |= concrete_members(kind) or {kind.__name__}
    return found


@pytest.mark.parametrize(
    "family",
    [
        AbstractController,
        AbstractDisturbance,
        AbstractObserver,
        AbstractPerformanceFunction,
        AbstractPlant,
        AbstractReference,
    ],
)
def test_no_member_of_a_family_is_missing_from_the_registry(family):
    registered = {type(build().member).__name__ for build in REGISTRY.values()}
    members = concrete_members(family)
    assert members
    assert members - OUTSIDE <= registered


class Law(eqx.Module):
    """A law of one gain, u = −k e, that remembers the integral of its error."""

    gain: jax.Array
    bias: float = eqx.field(static=True, default=0.0)


def law(tick, **options):
    member, memory = Law(jnp.array(2.0, float)), jnp.array(0.5, float)
    return Case(member, tick, memory, jnp.array([0.0, 1.0, -2.0]), **options)


def keeps_it(member, memory, error):
    return memory + DT * error, -member.gain * error + member.bias


def widens(member, memory, error):
    return memory + np.float64(DT) * error, -member.gain * error


def changes_type(member, memory, error):
    return (memory + error).astype(jnp.float32), -member.gain * error


def grows_weak(member, memory, error):
    return jnp.where(error > 0.0, 1.0, -1.0), -member.gain * error


def has_infinite_slope(member, memory, error):
    return memory, -jnp.sqrt(jnp.abs(member.gain * error))


def branches_in_python(member, memory, error):
    return memory, -member.gain * error if float(error) > 0 else 0.0 * error


def differs_when_traced(member, memory, error):
    traced = isinstance(error, jax.core.Tracer)
    return memory, -member.gain * error + (1.0 if traced else 0.0)


def test_contract_accepts_a_law_that_keeps_it():
    check_contract(law(keeps_it))


@pytest.mark.parametrize(
    ("tick", "complaint"),
    [
        (widens, "became float64"),
        (changes_type, "carry"),
        (grows_weak, "carry"),
        (has_infinite_slope, "gradient"),
        (branches_in_python, "concrete"),
        (differs_when_traced, "Not equal to tolerance"),
    ],
)
def test_contract_rejects_a_law_that_breaks_it(tick, complaint):
    with pytest.raises((AssertionError, TypeError), match=complaint):
        check_contract(law(tick))


def test_contract_rejects_a_number_that_is_static():
    def renumber(member, factor):
        return dataclasses.replace(member, bias=factor)

    with pytest.raises(AssertionError, match="traced 3 times"):
        check_contract(law(keeps_it, renumber=renumber))
