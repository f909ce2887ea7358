"""Yos: phases against a second implementation, orders, endings, and the flights."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from yo_oracle import Pilot

from jaxglider.guidance import AttitudeSchedule, Schedule, Yo
from jaxglider.guidance.obedience import obeyed
from jaxglider.guidance.phases import (
    PHASES,
    STATUSES,
    HalfYo,
    StopRules,
    SurfaceStay,
    Turning,
)
from jaxglider.guidance.settings import YoSettings
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Orders,
    Reference,
    zeros,
)

TICKS, DT = 260, 4.0
VARIANTS = (
    # orders at bottom and top, ballast between, looks within a half, limited steering
    ("pump", "mass", None, None, True),
    ("mass", "pump", None, 60.0, False),
    ("together", "together", 0.02, None, True),
    ("pump", "together", None, 40.0, False),
)
EACH = 250


def plans(rng, variant):
    """Settings of random missions, as the oracle has them."""
    bottom, top, between, looks, limited = variant
    for _ in range(EACH):
        yield {
            "dive_kg": rng.uniform(0.1, 0.3),
            "climb_kg": -rng.uniform(0.1, 0.3),
            "surface_kg": -rng.uniform(0.1, 0.3),
            "dive_rate": rng.uniform(0.1, 0.3),
            "climb_rate": rng.uniform(0.1, 0.3),
            "dive_looks": looks,
            "climb_looks": looks,
            "gain": rng.uniform(0.0, 0.5),
            "largest": 0.35,
            "bottom": rng.uniform(8.0, 30.0),
            "top": rng.uniform(1.0, 5.0),
            "altitude": rng.uniform(1.0, 6.0),
            "altimeter_range": rng.uniform(3.0, 50.0),
            "bottom_order": bottom,
            "top_order": top,
            "bottom_longest": rng.uniform(10.0, 60.0),
            "top_longest": rng.uniform(10.0, 60.0),
            "bottom_kg": between,
            "top_kg": None,
            "surface_depth": rng.uniform(0.5, 2.0),
            "first_stay": rng.choice([0.0, 10.0, 30.0]),
            "stay": rng.uniform(0.0, 60.0),
            "every_yos": 3,
            "every": rng.uniform(100.0, 900.0),
            "hover_rate": rng.uniform(0.0005, 0.05),
            "hover_time": rng.uniform(40.0, 400.0),
            "stall_time": rng.uniform(40.0, 200.0),
            "depth_rate_limit": rng.uniform(0.3, 1.0),
            "rate_memory": rng.uniform(5.0, 40.0),
            "share": rng.uniform(0.0, 1.0),
            "early_most": rng.uniform(0.1, 3.0),
            "yos": 4,
            "duration": rng.uniform(300.0, 2000.0),
            "dive_steering": rng.uniform(0.0, 1.0) if limited else None,
            "climb_steering": None,
            "bottom_steering": 0.0 if limited else None,
            "top_steering": rng.uniform(0.0, 1.0) if limited else None,
            "dive_wait": rng.uniform(0.0, 60.0) if limited else None,
            "climb_wait": rng.uniform(0.0, 60.0) if limited else None,
        }


def reference(p):
    """The yo reference with the numbers of a plan, which may be traced."""

    def half(name):
        sign = -1.0 if name == "dive" else 1.0
        return HalfYo(
            sign * 0.4,
            p[f"{name}_kg"],
            depth_rate=p[f"{name}_rate"],
            adjust_every=p[f"{name}_looks"],
            ballast_gain=p["gain"],
            largest=p["largest"],
            steering_limit=p[f"{name}_steering"],
            steering_wait=p[f"{name}_wait"],
        )

    settings = YoSettings(
        dive=half("dive"),
        climb=half("climb"),
        bottom=p["bottom"],
        top=p["top"],
        altitude=p["altitude"],
        altimeter_range=p["altimeter_range"],
        apogee=Turning(
            p["bottom_order"],
            p["bottom_longest"],
            buoyancy_mass=p["bottom_kg"],
            steering_limit=p["bottom_steering"],
        ),
        inflection=Turning(
            p["top_order"],
            p["top_longest"],
            buoyancy_mass=p["top_kg"],
            steering_limit=p["top_steering"],
        ),
        surface=SurfaceStay(
            p["surface_depth"],
            p["stay"],
            p["first_stay"],
            buoyancy_mass=p["surface_kg"],
            every_yos=p["every_yos"],
            every=p["every"],
        ),
        stop=StopRules(
            p["hover_rate"],
            p["hover_time"],
            p["stall_time"],
            p["depth_rate_limit"],
            p["rate_memory"],
        ),
        early_share=p["share"],
        early_most=p["early_most"],
        yos=p["yos"],
        duration=p["duration"],
    )
    course = AttitudeSchedule(Schedule([0.0], [0.0], [0.0], [0.0]))
    return Yo(course, settings)


def worlds(rng):
    """A kinematic glider and sensors for each mission: drift, pump, noise, jumps."""
    noise = rng.normal(0.0, 0.05, (EACH, TICKS))
    rare = rng.random((EACH, TICKS)) < 0.02
    jumps = np.where(rare, rng.normal(0.0, 30.0, (EACH, TICKS)), 0.0)
    return {
        "speed": rng.uniform(0.5, 1.3, EACH),
        "drift": rng.choice([0.0, 0.0, 0.0, 0.05, -0.1, 0.4, -0.8], EACH),
        "pump": rng.uniform(0.01, 0.05, EACH),
        "seabed": rng.choice([12.0, 25.0, 200.0], EACH),
        "battery": rng.choice([150.0, 1e4, 1e4, 1e4], EACH),
        "error": noise + jumps,
        "mass": np.cumsum(rng.choice([0.0, 0.0, 0.004], (EACH, TICKS)), axis=1),
    }


def moved(world, depth, pump, ordered):
    """Depth and ballast a tick later; operators that NumPy and JAX share."""
    step = world["pump"] * DT
    change = ordered - pump
    change = (
        (change > step) * step
        + (abs(change) <= step) * change
        - (change < -step) * step
    )
    pump = pump + change
    depth = depth + DT * (world["speed"] * pump + world["drift"] * 0.3)
    return depth * (depth > 0.0), pump


def flown_by_the_oracle(plan, world):
    pilot, depth, pump, rows = Pilot(plan, 0.0), 0.0, 0.0, []
    for n in range(TICKS):
        phase, status, ballast, held, limit = pilot.tick(
            n * DT,
            DT,
            depth + world["error"][n],
            world["seabed"] - depth,
            world["battery"] - n,
            pump,
            world["mass"][n],
        )
        rows.append((phase, status, held, ballast, limit))
        depth, pump = moved(world, depth, pump, ballast)
    return rows


def flown_by_the_reference(plan, world):
    yo = reference(plan)
    times = jnp.arange(TICKS) * DT
    still = GliderState.at_rest()

    def tick(carry, given):
        state, depth, pump, n = carry
        planned, error, mass = given
        measured = GliderState.at_rest(depth=depth + error)
        measurement = Measurement(
            state=measured,
            attitude=measured.attitude(),
            applied=Command(pump, mass, 0.0),
            disturbance=zeros(BodyAxes),
            altitude=world["seabed"] - depth,
            charge=world["battery"] - n,
        )
        aim, state = yo.step(state, planned, measurement, jnp.asarray(DT))
        o = aim.orders
        depth, pump = moved(world, depth, pump, o.buoyancy_mass)
        limit = jnp.inf if o.steering_limit is None else o.steering_limit
        row = o.phase, o.status, o.mass_held, o.buoyancy_mass, limit
        return (state, depth, pump, n + 1.0), row

    zero = jnp.zeros(())
    start = yo.init(still), zero, zero, zero
    given = yo.plan(times), world["error"], world["mass"]
    return jax.lax.scan(tick, start, given)[1]


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v[0]}-{v[1]}")
def test_phases_are_those_of_a_second_implementation(variant):
    """A thousand random missions in all, each of 260 ticks."""
    rng = np.random.default_rng(VARIANTS.index(variant))
    listed, world = list(plans(rng, variant)), worlds(rng)
    fixed = {
        k: v for k, v in listed[0].items() if k in ("yos", "every_yos") or v is None
    }
    fixed |= {k: v for k, v in listed[0].items() if isinstance(v, str)}
    traced = {
        k: jnp.asarray([p[k] for p in listed]) for k in listed[0] if k not in fixed
    }
    run = jax.jit(jax.vmap(lambda p, w: flown_by_the_reference(p | fixed, w)))
    found = [np.asarray(x) for x in run(traced, world)]
    seen = set()
    for n, plan in enumerate(listed):
        one = {k: v[n] for k, v in world.items()}
        rows = flown_by_the_oracle(plan, one)
        for k, name in enumerate(("phase", "status", "held")):
            np.testing.assert_array_equal(
                found[k][n], [row[k] for row in rows], err_msg=f"mission {n}: {name}"
            )
        for k in (3, 4):
            np.testing.assert_allclose(found[k][n], [r[k] for r in rows], atol=1e-12)
        seen |= {PHASES[row[0]] for row in rows} | {STATUSES[rows[-1][1]]}
    assert set(PHASES) <= seen
    ends = {"under way", "completed", "bottom", "hover", "stall", "battery empty"}
    assert ends <= seen


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"bottom": 2.0}, "top - bottom"),
        ({"dive_kg": -0.1}, "dive.buoyancy_mass"),
        ({"share": 1.5}, "early_share"),
        ({"bottom_order": "first"}, "Turning.order"),
        ({"hover_time": 0.0}, "hover_time"),
        ({"stay": -1.0}, "duration"),
        ({"dive_wait": -1.0}, "steering_wait"),
        ({"top_steering": -0.1}, "steering_limit"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change, rule):
    plan = next(plans(np.random.default_rng(0), VARIANTS[0])) | {"top": 3.0}
    with pytest.raises(ValueError, match=rule):
        reference(plan | change)


def test_a_law_steers_no_farther_than_its_plan_lets_it():
    wanted, held = Command(0.1, 0.02, -0.4), Command(0.0, 0.0, 0.1)
    one, none = jnp.asarray(1.0), jnp.asarray(0)
    orders = Orders(0.2 * one, 0.2 * one, jnp.asarray(False), none, none)

    def angle(**changes):
        changes = {name: value * one for name, value in changes.items()}
        still = Channels(one, one, one)
        aim = Reference(still, still, still, one, none, jnp.asarray(False))
        aim = dataclasses.replace(aim, orders=dataclasses.replace(orders, **changes))
        return float(obeyed(wanted, aim, held).mass_angle)

    assert angle() == angle(steering_limit=jnp.inf) == -0.4
    assert angle(steering_limit=0.25) == -0.25
    assert angle(steering_limit=0.0) == 0.0
    assert angle(steering=0.3, steering_limit=0.25) == 0.25
