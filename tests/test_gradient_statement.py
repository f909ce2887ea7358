"""One line on a gradient: right, wrong, not finite, or of a run that is lost nearby."""

import json

import numpy as np
import pytest
import tomli_w

from tuning.gradient_check.statement import AGREES, STEPS, gradient_statement

POINT = np.array([0.4, -1.2, 0.7])


def curved(rows):
    """A smooth valley; its gradient stands below."""
    return np.exp(rows[..., 0]) + rows[..., 1] ** 2 * np.cos(rows[..., 2])


def slope(x):
    down = 2.0 * x[1] * np.cos(x[2])
    return curved(x), np.array([np.exp(x[0]), down, -(x[1] ** 2) * np.sin(x[2])])


def test_a_right_gradient_agrees_with_differences():
    statement = gradient_statement(slope, curved, POINT, 800.0)
    assert statement.finite
    assert statement.of_use
    assert statement.difference < 1e-7
    assert "whole run of 800 s: finite, within" in statement.text()
    assert statement.text().endswith("right.")


@pytest.mark.parametrize("factor", [0.9, 0.0, -1.0, 1e6])
def test_a_gradient_that_is_off_is_of_no_use(factor):
    """Scaled, with nothing left of it, turned round, and exploded."""
    wrong = gradient_statement(
        lambda x: (curved(x), factor * slope(x)[1]), curved, POINT, 20.0
    )
    expected = {0.9: 0.1, 0.0: 1.0, -1.0: 2.0, 1e6: 1.0}[factor]
    assert wrong.difference == pytest.approx(expected, rel=1e-3)
    assert not wrong.of_use
    assert "of no use" in wrong.text()


def test_one_wrong_component_is_found():
    def wrong(x):
        value, gradient = slope(x)
        return value, gradient * [1.0, 1.0, 0.0]

    assert gradient_statement(wrong, curved, POINT, 20.0).difference > AGREES


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_gradient_that_is_not_finite_is_said_to_be_so(bad):
    statement = gradient_statement(
        lambda x: (curved(x), slope(x)[1] * [1.0, bad, 1.0]), curved, POINT, 20.0
    )
    assert (statement.finite, statement.of_use, statement.difference) == (
        *(False, False),
        None,
    )
    assert "not finite" in statement.text()
    assert statement.to_dict() == {
        "finite": False,
        "of_use": False,
        "steps": list(STEPS),
        "seconds": 20.0,
    }


def test_a_run_lost_beside_the_gains_is_told_apart():
    def lost(rows):
        return np.where(rows[..., 0] > POINT[0], np.nan, curved(rows))

    statement = gradient_statement(slope, lost, POINT, 20.0)
    assert (statement.finite, statement.difference) == (True, None)
    assert "objective beside the gains is not" in statement.text()


def test_noise_at_small_steps_and_curvature_at_large_ones_are_forgiven():
    draw = np.random.default_rng(1)

    def noisy(rows):
        wave = 1e-9 * draw.standard_normal(len(rows))
        return curved(rows) + wave + 1e3 * (rows[..., 0] - POINT[0]) ** 3

    assert gradient_statement(slope, noisy, POINT, 20.0).of_use


def test_a_flat_objective_is_right_to_be_flat():
    flat = gradient_statement(
        lambda x: (1.0, np.zeros(3)), lambda rows: np.ones(len(rows)), POINT, 20.0
    )
    assert flat.difference == 0.0


def test_it_goes_into_json_and_toml():
    statement = gradient_statement(slope, curved, POINT, 20.0).to_dict()
    assert json.loads(json.dumps(statement)) == statement
    assert "of_use = true" in tomli_w.dumps({"gradient": statement})
