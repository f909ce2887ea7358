"""Quantile functions against SciPy's distributions and closed forms."""

import numpy as np
import pytest
from scipy import stats

from jaxglider.uncertainty.distributions import (
    LogNormal,
    Mixture,
    TruncatedNormal,
    Uniform,
    correlated,
)

U = np.linspace(0.001, 0.999, 97)
CASES = {
    "uniform": (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    "normal": (TruncatedNormal(2.0, 0.5, 2.0), stats.truncnorm(-2, 2, 2.0, 0.5)),
    "log-normal": (
        LogNormal(3.0, 0.4, 2.5),
        # ln x is a cut normal: compared on its own scale below.
        stats.truncnorm(-2.5, 2.5, np.log(3.0), 0.4),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_quantiles_are_those_of_scipy(name):
    law, oracle = CASES[name]
    found = law.quantile(U)
    if name == "log-normal":
        found = np.log(found)
    np.testing.assert_allclose(found, oracle.ppf(U), rtol=1e-11)


@pytest.mark.parametrize("name", ["uniform", "normal"])
def test_standard_deviation_is_that_of_scipy(name):
    law, oracle = CASES[name]
    assert law.standard_deviation() == pytest.approx(oracle.std(), rel=1e-3)


def test_standard_deviation_of_a_wide_log_normal_is_the_closed_form():
    s = 0.4
    wanted = np.exp(0.5 * s * s) * np.sqrt(np.expm1(s * s))
    assert LogNormal(1.0, s, 8.0).standard_deviation() == pytest.approx(
        wanted, rel=2e-3
    )


def test_support_is_where_the_values_end():
    assert Uniform(0.8, 1.2).support() == pytest.approx((0.8, 1.2))
    assert TruncatedNormal(1.0, 0.1, 2.0).support() == pytest.approx((0.8, 1.2))
    assert LogNormal(2.0, 1.0, 1.0).support() == pytest.approx((2 / np.e, 2 * np.e))
    assert Mixture(0.5, Uniform(1.0, 2.0), 9.0).support() == pytest.approx((1.0, 9.0))


def test_sometimes_happens_as_often_as_it_says():
    found = Mixture(0.25, Uniform(10.0, 20.0), 99.0).quantile(
        (np.arange(400) + 0.5) / 400
    )
    happened = found < 99.0
    assert happened.sum() == 100
    assert found[happened].mean() == pytest.approx(15.0)
    assert np.all(Mixture(0.0, Uniform(1.0, 2.0), 99.0).quantile(U) == 99.0)
    np.testing.assert_array_equal(
        Mixture(1.0, Uniform(1.0, 2.0), 99.0).quantile(U),
        Uniform(1.0, 2.0).quantile(U),
    )


def test_a_copula_has_the_correlation_and_keeps_the_columns_uniform():
    u = np.random.default_rng(0).random((20000, 3))
    wanted = np.array([[1.0, 0.7, -0.2], [0.7, 1.0, 0.3], [-0.2, 0.3, 1.0]])
    found = correlated(u, wanted)
    scores = stats.norm.ppf(found)
    # Standard error of a correlation of 20,000 pairs: 0.007.
    np.testing.assert_allclose(np.corrcoef(scores.T), wanted, atol=0.03)
    for column in found.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3
    np.testing.assert_array_equal(correlated(u[7:8], wanted), found[7:8])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Uniform(2.0, 1.0), r"Uniform\.high must be at least 2"),
        (lambda: Uniform(0.0, np.inf), r"Uniform\.high must be finite"),
        (lambda: TruncatedNormal(0.0, 0.0), r"TruncatedNormal\.deviation must be pos"),
        (lambda: TruncatedNormal(0.0, 1.0, -1.0), r"truncation must be positive"),
        (lambda: LogNormal(0.0, 1.0), r"LogNormal\.median must be positive"),
        (lambda: Mixture(1.5, Uniform(0.0, 1.0), 0.0), r"probability must be in"),
        (lambda: correlated(U[:, None], np.array([[2.0]])), "correlation must be"),
        (
            lambda: correlated(np.ones((1, 2)), np.array([[1.0, 1.5], [1.5, 1.0]])),
            "positive definite",
        ),
    ],
)
def test_what_is_no_distribution_is_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()
