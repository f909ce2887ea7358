"""Rows of the unit cube: the same alone or in company, and evenly spread."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from jaxglider.uncertainty.sampling import LatinHypercube, MonteCarlo, SobolSequence

NAMES = ("drag", "lift_slope", "wave")
DESIGNS = {
    "monte-carlo": MonteCarlo(5, NAMES),
    "sobol": SobolSequence(5, 3),
    "latin": LatinHypercube(5, 3, 64),
}


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize(("first", "count"), [(0, 1), (13, 7), (16, 4), (63, 1)])
def test_any_stretch_is_a_part_of_the_whole(name, first, count):
    design = DESIGNS[name]
    whole = design.rows(0, 64)
    np.testing.assert_array_equal(
        design.rows(first, count), whole[first : first + count]
    )
    assert whole.shape == (64, 3)
    assert np.all((whole > 0.0) & (whole < 1.0))


@pytest.mark.parametrize("name", DESIGNS)
def test_another_seed_gives_other_rows(name):
    rows = DESIGNS[name].rows(0, 64)
    other = {
        "monte-carlo": MonteCarlo(6, NAMES),
        "sobol": SobolSequence(6, 3),
        "latin": LatinHypercube(6, 3, 64),
    }[name]
    assert not np.any(rows == other.rows(0, 64))


def test_a_column_depends_on_its_own_name_alone():
    rows = MonteCarlo(5, NAMES).rows(0, 20)
    np.testing.assert_array_equal(MonteCarlo(5, ("wave",)).rows(0, 20), rows[:, 2:])
    moved = MonteCarlo(5, ("more", "wave", "drag")).rows(0, 20)
    np.testing.assert_array_equal(moved[:, 1:], rows[:, [2, 0]])


def test_streams_share_no_row():
    every = [MonteCarlo(5, ("drag",), stream).rows(0, 50) for stream in range(4)]
    assert len(np.unique(np.concatenate(every))) == 200


def test_independent_draws_are_uniform_and_uncorrelated():
    rows = MonteCarlo(1, NAMES).rows(0, 20000)
    for column in rows.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3
    np.testing.assert_allclose(np.corrcoef(rows.T), np.eye(3), atol=0.03)


def test_latin_hypercube_has_one_member_in_each_slice():
    rows = DESIGNS["latin"].rows(0, 64)
    for column in rows.T:
        np.testing.assert_array_equal(np.sort(np.floor(64 * column)), np.arange(64))


def test_sobol_points_fill_the_cube_more_evenly_than_draws():
    even = qmc.discrepancy(DESIGNS["sobol"].rows(0, 64))
    assert even < 0.3 * qmc.discrepancy(DESIGNS["monte-carlo"].rows(0, 64))
