"""Gains as TOML: what is written is what is read, and what is odd is refused."""

import copy
import dataclasses
import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest
import tomli_w

from jaxglider import BankSteering, Inversion, paper
from jaxglider.control.catalogue import BY_NAME
from jaxglider.control.fxtppc import tian_exponents
from jaxglider.control.observer import FixedTimeObserver, NoObserver
from jaxglider.control.prescribed.performance import (
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.core.toml import ConfigError
from jaxglider.files.codec import FAMILIES, decode, encode
from jaxglider.files.gains import decode_gains

MODEL = paper.design_model(paper.make_scenario().plant)
LAWS = (*paper.CONTROLLERS, paper.ROLL_AWARE)


def _observer(name):
    return NoObserver() if name == "none" else paper.fixed_time_observer(MODEL)


def _leaves(thing):
    """Every number of a controller or observer but those of its design model."""
    if hasattr(thing, "model"):
        thing = eqx.tree_at(lambda t: t.model, thing, None)
    return [np.asarray(leaf) for leaf in jax.tree.leaves(thing)]


def _scattered(thing, seed):
    """All numbers shrunk by different amounts, so that no default is left."""
    rng = np.random.default_rng(seed)
    model = getattr(thing, "model", None)
    moved = jax.tree.map(lambda x: x * rng.uniform(0.9, 0.99), thing)
    return moved if model is None else eqx.tree_at(lambda t: t.model, moved, model)


def _through_toml(thing):
    return tomllib.loads(tomli_w.dumps({"it": encode(thing)}))["it"]


@pytest.mark.parametrize("scenario", paper.SCENARIOS)
@pytest.mark.parametrize("name", LAWS)
def test_a_controller_comes_back_bit_by_bit(name, scenario):
    template = paper.make_controller(name, scenario, MODEL)
    written = _scattered(template, seed=len(name))
    assert any(
        not np.array_equal(a, b)
        for a, b in zip(_leaves(template), _leaves(written), strict=True)
    )
    read = decode(template, _through_toml(written), "controller")
    assert type(read) is type(written)
    assert read.model is template.model
    for a, b in zip(_leaves(written), _leaves(read), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["none", "fixed-time"])
def test_an_observer_comes_back_bit_by_bit(name):
    template = _observer(name)
    written = _scattered(template, seed=3)
    read = decode(template, _through_toml(written), "observer")
    assert type(read) is type(written)
    for a, b in zip(_leaves(written), _leaves(read), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_is_no_number_comes_back_too():
    written = dataclasses.replace(
        paper.make_controller("fxtppc", "switching", MODEL),
        exponents=tian_exponents,
        funnel=paper.funnel("waypoints", HalfSechFunction),
    )
    template = paper.make_controller("fxtppc", "switching", MODEL)
    read = decode(template, _through_toml(written), "controller")
    assert read.exponents is tian_exponents
    assert type(read.funnel.performance.heading) is HalfSechFunction
    observer = dataclasses.replace(paper.fixed_time_observer(MODEL), newton_steps=7)
    steps = decode(_observer("fixed-time"), _through_toml(observer), "observer")
    assert steps.newton_steps == 7


def test_the_design_model_is_not_written():
    table = encode(paper.make_controller("fxtppc", "switching", MODEL))
    assert "model" not in table
    assert set(table) == {
        "type",
        "funnel",
        "gains",
        "damping",
        "steering",
        "smoothing",
        "exponents",
    }


def test_keys_carry_the_unit_of_their_channel():
    performance = encode(paper.make_controller("ppc", "switching", MODEL))["funnel"][
        "performance"
    ]
    assert set(performance["depth"]) == {
        "type",
        "initial",
        "final_bound_m",
        "settling_time_s",
    }
    for channel in ("pitch", "heading"):
        assert "final_bound_rad" in performance[channel]
    assert performance["depth"]["final_bound_m"] == 0.2
    assert performance["pitch"]["settling_time_s"] == 80.0


def test_a_partial_table_keeps_the_rest_of_the_template():
    template = paper.make_controller("fxtppc", "waypoints", MODEL)
    read = decode(template, {"gains": {"pitch": {"k1": 0.5}}}, "controller")
    assert float(read.gains.pitch.k1) == 0.5
    back = eqx.tree_at(lambda c: c.gains.pitch.k1, read, template.gains.pitch.k1)
    assert eqx.tree_equal(back, template)


def test_the_law_within_the_roll_aware_one_is_of_one_kind():
    template = paper.make_controller(paper.ROLL_AWARE, "switching", MODEL)
    with pytest.raises(ConfigError, match=r"controller\.law\.type .* one of fxtppc;"):
        decode(template, {"law": {"type": "smc"}}, "controller")


def test_a_file_that_says_nothing_of_steering_means_inversion_on_every_plant():
    model = paper.design_model(paper.make_scenario("switching", "rigid-body").plant)
    begins = paper.make_controller("fxtppc", "switching", model)
    assert isinstance(begins.steering, BankSteering)
    first = decode_gains({"controller": {"type": "fxtppc"}}, "switching", model)
    assert eqx.tree_equal(first.controller, begins)
    older = {"controller": {"type": "fxtppc", "gains": {"depth": {"k1": 0.002}}}}
    law = decode_gains(older, "switching", model).controller
    assert isinstance(law.steering, Inversion)
    assert law.hedging is None
    named = {"type": "bank", "largest_bank_rad": 0.5, "smallest_response_per_s3": 2e-3}
    newer = {"controller": {"type": "fxtppc", "steering": named, "hedging": 0.25}}
    law = decode_gains(newer, "switching", model).controller
    assert (float(law.steering.largest_bank), float(law.hedging)) == (0.5, 0.25)
    again = decode_gains(
        {"controller": _through_toml(law)}, "switching", model
    ).controller
    assert eqx.tree_equal(again, law)


def test_an_empty_table_is_the_template():
    for name in LAWS:
        template = paper.make_controller(name, "switching", MODEL)
        assert eqx.tree_equal(decode(template, {}, "controller"), template)


def test_the_form_of_a_performance_function_can_be_changed():
    template = paper.make_controller("fxtppc", "switching", MODEL)
    table = {"funnel": {"performance": {"depth": {"type": "exponential"}}}}
    depth = decode(template, table, "controller").funnel.performance.depth
    assert type(depth) is ExponentialFunction
    assert (
        float(depth.initial),
        float(depth.final_bound),
        float(depth.settling_time),
    ) == (
        1.0,
        0.2,
        100.0,
    )
    other = decode(template, table, "controller").funnel.performance.pitch
    assert type(other) is SechFunction


def test_reading_leaves_the_table_alone():
    template = paper.make_controller("fxtppc", "switching", MODEL)
    table = encode(template)
    before = copy.deepcopy(table)
    decode(template, table, "controller")
    assert table == before


def test_every_name_stands_for_a_member_of_its_family():
    assert [sorted(members) for members in FAMILIES.values()] == [
        sorted(BY_NAME),
        ["fixed-time", "none"],
        ["fixed-time", "linear", "model-aided", "perfect"],
        ["exponential", "ppc", "sech"],
        ["bank", "inversion"],
    ]
    for base, members in FAMILIES.items():
        assert all(issubclass(member, base) for member in members.values())


def test_a_stranger_to_the_names_cannot_be_written():
    controller = dataclasses.replace(
        paper.make_controller("fxtppc", "switching", MODEL),
        exponents=lambda rho: ((rho, rho), (rho, rho)),
    )
    with pytest.raises(ConfigError, match="has no name in paper, tian"):
        encode(controller)


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        (
            {"gains": {"depth": {"k1": float("nan")}}},
            ("gains.depth.k1", "finite", "nan"),
        ),
        ({"gains": {"depth": {"k1": "big"}}}, ("gains.depth.k1", "a number", "'big'")),
        ({"gains": {"depth": {"k1": True}}}, ("gains.depth.k1", "a number", "True")),
        ({"gains": {"depth": {"k1": 10**400}}}, ("gains.depth.k1", "finite")),
        ({"gains": {"depth": {"k1": -1.0}}}, ("gains.depth", "k1", "positive", "-1.0")),
        (
            {"gains": {"depth": {"rho": 1.0}}},
            ("gains.depth", "rho", "in (0, 1)", "1.0"),
        ),
        (
            {"gains": {"depth": {"rho": 0}}},
            ("gains.depth", "rho", "in (0, 1)", "0.0"),
        ),
        ({"gains": {"depth": {"mu": 1}}}, ("gains.depth", "mu", "above 1", "1.0")),
        ({"gains": {"depth": 3}}, ("gains.depth", "must be a table", "3")),
        ({"gains": {"dept": {}}}, ("unknown key", "gains.dept", "did you mean depth?")),
        ({"gain": {}}, ("unknown key", "controller.gain", "did you mean gains?")),
        ({"model": {}}, ("unknown key", "controller.model")),
        ({"exponents": "own"}, ("exponents", "one of paper, tian", "'own'")),
        ({"type": "lqg"}, ("controller.type", "smc, ppc, fxtppc", "'lqg'")),
        ({"smoothing": 0}, ("controller", "smoothing", "positive", "0.0")),
        ({"damping": {"mass_angle": -1}}, ("controller", "damping", "positive", "-1")),
        (
            {"funnel": {"performance": {"depth": {"final_bound_m": 0.65}}}},
            (
                "funnel.performance.depth",
                "final_bound",
                "0.648054",
                "0.65",
                "lower final_bound or initial",
            ),
        ),
        (
            {"funnel": {"performance": {"depth": {"final_bound_rad": 0.1}}}},
            ("final_bound_rad", "did you mean final_bound_m?"),
        ),
        (
            {"funnel": {"performance": {"pitch": {"type": "cosh"}}}},
            ("performance.pitch.type", "sech, exponential, ppc", "'cosh'"),
        ),
        (
            {"funnel": {"performance": {"pitch": {"settling_time_s": 0}}}},
            ("performance.pitch", "settling_time", "positive"),
        ),
    ],
)
def test_wrong_gains_are_refused_by_path_rule_and_value(table, parts):
    template = paper.make_controller("fxtppc", "switching", MODEL)
    with pytest.raises(ConfigError) as caught:
        decode(template, table, "controller")
    message = str(caught.value)
    assert "controller" in message
    for part in parts:
        assert part in message


def test_the_bound_on_the_final_bound_is_sech_of_the_initial():
    template = paper.make_controller("fxtppc", "switching", MODEL)

    def depth(bound):
        return {"funnel": {"performance": {"depth": {"final_bound_m": bound}}}}

    edge = 1.0 / np.cosh(1.0)
    decode(template, depth(edge - 1e-9), "controller")
    with pytest.raises(ConfigError):
        decode(template, depth(edge + 1e-9), "controller")


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ({"newton_steps": 1.5}, ("observer.newton_steps", "whole number", "1.5")),
        ({"newton_steps": 0}, ("observer", "newton_steps", "at least 1", "0")),
        ({"stretch": {"yaw": 0}}, ("observer", "stretch.yaw", "positive", "0.0")),
        ({"integral": {"jaw": 1}}, ("observer.integral.jaw", "did you mean yaw?")),
        ({"type": "kalman"}, ("observer.type", "none, fixed-time", "'kalman'")),
    ],
)
def test_a_wrong_observer_is_refused_by_path_rule_and_value(table, parts):
    with pytest.raises(ConfigError) as caught:
        decode(paper.fixed_time_observer(MODEL), table, "observer")
    for part in parts:
        assert part in str(caught.value)


def test_a_fixed_time_observer_can_be_switched_off():
    template = paper.fixed_time_observer(MODEL)
    assert type(template) is FixedTimeObserver
    assert type(decode(template, {"type": "none"}, "observer")) is NoObserver
