"""Profile likelihood and advice of a fit, against closed forms."""

import dataclasses

import numpy as np
import pytest

from tuning.identification.information.least_squares import solve
from tuning.identification.information.likelihood import SearchedStage, profiles
from tuning.identification.information.manoeuvres import SAME, advice, best_of
from tuning.identification.information.noise import Noise
from tuning.identification.parameters import FreeParameter

NOISE = {"depth_rate": Noise(0.01, 1.0, 200)}


@dataclasses.dataclass(frozen=True)
class Model:
    """Rows that are basis @ f(x), for f straight or bent in the first coordinate."""

    basis: np.ndarray
    bend: float = 0.0

    def __call__(self, x):
        first = x[0] + self.bend * x[0] ** 2
        inner = np.concatenate([[first], x[1:]])
        slopes = self.basis.copy()
        slopes[:, 0] *= 1.0 + 2.0 * self.bend * x[0]
        return {"depth_rate": self.basis @ inner}, {"depth_rate": slopes}

    def changed(self, change):
        return Model(change(self.basis), self.bend)


def stage(basis, bend=0.0, start=2.0):
    model = Model(basis, bend)
    measured = {"depth_rate": model(np.full(basis.shape[1], 0.1))[0]["depth_rate"]}
    solution = solve(model, measured, basis.shape[1], noise=NOISE)
    numbers = tuple(
        FreeParameter(name, "m", start, 0.5, start < 0.0, True)
        for name in ("a", "b")[: basis.shape[1]]
    )
    return SearchedStage(numbers, model, measured, solution)


def test_the_profile_of_a_straight_model_is_the_fisher_interval():
    x = np.linspace(-1.0, 1.0, 200)
    straight = stage(np.stack([0.01 * np.ones(200), 0.003 * x + 0.002], axis=1))
    found = profiles([straight], 2)
    # The robust loss of residuals that are almost zero is the plain one.
    for k, name in enumerate(("a", "b")):
        at = 2.0 + 0.5 * straight.solution.x[k]
        half = 1.96 * 0.5 * straight.solution.covariance[k, k] ** 0.5
        assert found[name] == pytest.approx((at - half, at + half), rel=0.02)


def test_the_interval_of_a_negative_number_goes_from_low_to_high():
    below = stage(0.01 * np.ones((200, 1)), start=-2.0)
    low, high = profiles([below], 1)["a"]
    at, half = below.solution.x[0], 1.96 * below.solution.covariance[0, 0] ** 0.5
    expected = -2.0 * np.exp(0.25 * np.array([at + half, at - half]))
    assert (low, high) == pytest.approx(tuple(expected), rel=0.02)


def test_only_the_numbers_told_worst_are_looked_at():
    x = np.linspace(-1.0, 1.0, 200)
    one = stage(np.stack([np.ones(200), 0.001 * x], axis=1))
    assert list(profiles([one], 1)) == ["b"]
    assert profiles([one], 0) == {}


def test_a_bent_model_has_the_interval_of_its_own_loss():
    basis = 0.004 * np.ones((200, 1))
    bent = stage(basis, bend=0.4)
    low, high = profiles([bent], 1)["a"]
    best = bent.solution.x[0]

    def rise(value):
        def loss(x):
            rows = (
                bent.model(np.array([x]))[0]["depth_rate"] - bent.measured["depth_rate"]
            ) / 0.01
            limit = 4.0
            robust = 2.0 * limit * (np.sqrt(1.0 + rows**2 / limit) - 1.0)
            return robust.sum() + x * x

        return loss((value - 2.0) / 0.5) - loss(best)

    assert rise(low) == pytest.approx(3.84, rel=0.03)
    assert rise(high) == pytest.approx(3.84, rel=0.03)
    # Steeper above than below: the interval is not even.
    assert high - (2.0 + 0.5 * best) < 0.9 * ((2.0 + 0.5 * best) - low)


def test_what_to_fly_is_what_adds_most_information(monkeypatch):
    changes = {SAME: lambda b: b, "twice": lambda b: 2.0 * b, "none": lambda b: 0.0 * b}
    monkeypatch.setattr(
        "tuning.identification.information.manoeuvres.MANOEUVRES", changes
    )
    one = stage(0.001 * np.ones((200, 1)))
    told = advice([one])
    manoeuvre, share, same = best_of(told, "a")
    assert manoeuvre == "twice"
    # Information 200 (0.001/0.01)² = 2, and 1 of the prior.
    assert same == pytest.approx(np.sqrt(3.0 / 5.0), rel=1e-6)
    assert share == pytest.approx(np.sqrt(3.0 / 11.0), rel=1e-6)
    assert best_of(told, "b") is None
