"""Trajectories as tables that a spreadsheet reads: CSV, or Parquet."""

import csv
import importlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.files.results import column, variables
from jaxglider.files.writing import replacing, write_text
from jaxglider.simulation.rollout import Trajectory

KINDS = ("csv", "parquet")
"""Endings of the files, by which they are asked for."""
_UNITS = {"m s-1": "m_s", "rad s-1": "rad_s", "N m": "N_m", "1": ""}


def table_of(run: Trajectory) -> dict[str, np.ndarray]:
    """Columns of a run by name and unit, such as `pitch_rad`; a row a record.

    Args:
        run: trajectory on the host.
    """
    active = np.asarray(run.ticks.active, bool)
    columns = {"time_s": np.asarray(run.ticks.time, np.float64)}
    onboard, energy = (x is not None for x in (run.ticks.onboard, run.ticks.energy))
    for name, unit, _, where in variables(onboard, energy):
        key = f"{name}_{_UNITS.get(unit, unit)}".rstrip("_")
        columns[key] = column(run.ticks, where)
    if run.ticks.phase is not None:
        columns["phase"] = np.asarray(run.ticks.phase)
    return {name: values[active] for name, values in columns.items()}


def write_table(path: Path, run: Trajectory) -> Path:
    """Write a run as CSV or Parquet, by the ending of the file.

    Args:
        path: file to write.
        run: trajectory on the host.

    Raises:
        ValueError: Parquet is asked for and pyarrow is not installed.
    """
    columns = table_of(run)
    if path.suffix == ".parquet":
        _write_parquet(path, columns)
        return path
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    rows.writerows(
        [f"{value:.10g}" for value in row]
        for row in zip(*columns.values(), strict=True)
    )
    write_text(path, text.getvalue())
    return path


def check_kind(kind: str | None) -> None:
    """Refuse a kind of table that cannot be written here, before the work.

    Raises:
        ValueError: Parquet is asked for and pyarrow is not installed.
    """
    if kind == "parquet":
        _pyarrow()


def _pyarrow() -> Any:
    """The package pyarrow with its Parquet part."""
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise ValueError(
            "--table parquet needs the package pyarrow: `pip install pyarrow`, or take "
            "--table csv."
        ) from error


def _write_parquet(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    arrow = _pyarrow()
    with replacing(path) as temporary:
        arrow.parquet.write_table(arrow.table(dict(columns)), temporary)
