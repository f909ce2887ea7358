"""The sheet of all figures, drawn again from records; and tables of flights."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from matplotlib import image

from tuning.evaluation.trajectory_tables import check_kind, table_of, write_table

DOCS = Path(__file__).parents[1] / "docs"
TOLERANCE, BLANK = 6.0, 0.01
"""Mean difference of a cell [of 255], its blocks of 6 by 6 pixels averaged, and share
of pixels that are not white in a figure that shows something."""


@pytest.fixture(scope="module")
def page():
    spec = importlib.util.spec_from_file_location("figures", DOCS / "figures.py")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(DOCS))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(DOCS))
    return module


@pytest.fixture(scope="module")
def drawn(page):
    return dict(page.cells())


def blurred(picture):
    """Grey values of a picture, averaged over blocks: letters may move by a pixel."""
    grey = picture.astype(float).mean(axis=2)
    side = grey.shape[0] // 6 * 6
    return grey[:side, :side].reshape(side // 6, 6, side // 6, 6).mean(axis=(1, 3))


def test_every_figure_is_as_it_was_when_somebody_looked(page, drawn):
    stored = (image.imread(page.SHEET)[:, :, :3] * 255.0).round()
    assert stored.shape == page.sheet(drawn).shape
    side, apart = page.SIDE, {}
    for number, (name, cell) in enumerate(drawn.items()):
        row, column = divmod(number, page.COLUMNS)
        there = stored[side * row :, side * column :][:side, :side]
        apart[name] = float(np.abs(blurred(cell) - blurred(there)).mean())
    assert max(apart.values()) < TOLERANCE, apart


def test_no_figure_is_blank_and_the_sheet_would_show_another_one(page, drawn):
    for name, cell in drawn.items():
        assert (cell < 250).any(axis=2).mean() > BLANK, name
    # What the tolerance is worth: two figures are farther apart than it allows.
    first, second = list(drawn.values())[1:3]
    assert np.abs(blurred(first) - blurred(second)).mean() > TOLERANCE


def test_headings_do_not_jump_and_each_figure_has_its_title(page):
    title, _, flown = page.flights()["failed"]
    (law,) = flown
    run = page.recorded("failed", law)
    made = dict(page.figures(flown[law].scenario, {"FxTPPC": run}, title=title))
    for name, figure in made.items():
        if name != "performance_functions":
            assert figure.get_suptitle() == f"{title}, FxTPPC"
    for axis in made["tracking"].axes[2:3]:
        for line in axis.lines:
            steps = np.abs(np.diff(np.asarray(line.get_ydata(), float)))
            assert np.nanmax(steps, initial=0.0) < 180.0


def test_a_trajectory_as_a_table_has_units_in_its_names(page, tmp_path):
    run = page.recorded("failed", next(iter(page.flights()["failed"][2])))
    path = write_table(tmp_path / "run.csv", run)
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert {"time_s", "pitch_rad", "mass_angle_applied_rad", "surge_m_s"} <= set(
        table.dtype.names
    )
    np.testing.assert_allclose(table["pitch_rad"], run.ticks.state.pitch, rtol=1e-6)
    assert len(table) == len(run.ticks.time)


def test_a_trajectory_as_parquet_has_the_columns_of_its_table(page, tmp_path):
    run = page.recorded("failed", next(iter(page.flights()["failed"][2])))
    table = pyarrow.parquet.read_table(write_table(tmp_path / "run.parquet", run))
    columns = table_of(run)
    assert table.column_names == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(table[name].to_numpy(), values)


def test_parquet_is_refused_before_the_work_where_it_cannot_be_written(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ValueError, match="needs the package pyarrow"):
        check_kind("parquet")
