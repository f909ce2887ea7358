"""Density over depth from a file.

A .csv with depth_m and density_kg_m3, or with depth_m, temperature_degC and salinity;
or NetCDF with temperature and salinity over depth, as ocean models and climatologies
have them, at the place of the start. Density is that of TEOS-10, by the package gsw.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.moment import Moment
from jaxglider.files.sea.netcdf import (
    at_place,
    at_time,
    depths,
    found,
    opened,
    over,
    variable,
)
from jaxglider.files.sea.texts import csv_table, text_of


def read_profile(path: Path, moment: Moment) -> dict[str, Any]:
    """Depths [m] and densities [kg/m³] of a profile.

    Args:
        path: CSV or NetCDF file.
        moment: place and time of the start.

    Raises:
        ConfigError: it cannot be read, or lacks what is needed.
    """
    if path.suffix.lower() == ".csv":
        depth, density = _csv_profile(path)
    else:
        depth, density = _model_profile(path, moment)
    good = np.isfinite(depth) & np.isfinite(density)
    order = np.argsort(depth[good], kind="stable")
    depth, density = depth[good][order], density[good][order]
    if len(depth) < 2:
        raise ConfigError(f"{path}: a profile needs two depths at least.")
    if depth[-1] <= 0.0:
        raise ConfigError(
            f"{path}: depth must be positive down; received {depth[0]:g} to "
            f"{depth[-1]:g} m."
        )
    if not (np.all(density > 950.0) and np.all(density < 1100.0)):
        raise ConfigError(
            f"{path}: density must be in kg/m^3, from 950 to 1100; received "
            f"{density.min():g} to {density.max():g}. Anomalies (sigma) lack 1000."
        )
    kept = np.concatenate([[True], np.diff(depth) > 0.0])
    return {
        "depth_m": depth[kept].tolist(),
        "density_kg_m3": density[kept].tolist(),
    }


def _csv_profile(path: Path) -> tuple[np.ndarray, np.ndarray]:
    head, rows = csv_table(path, text_of(path))

    def column(name: str) -> np.ndarray:
        return np.array([_number(path, name, n, row[name]) for n, row in rows])

    if "depth_m" in head and "density_kg_m3" in head:
        return column("depth_m"), column("density_kg_m3")
    if {"depth_m", "temperature_degC", "salinity"} <= set(head):
        depth = column("depth_m")
        return depth, _density(
            path, depth, column("temperature_degC"), column("salinity")
        )
    raise ConfigError(
        f"{path}: the first line must name depth_m and density_kg_m3, or depth_m, "
        f"temperature_degC and salinity; received {', '.join(head) or 'nothing'}."
    )


def _number(path: Path, name: str, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise ConfigError(
            f"{path}: {name} in line {line} must be a number, nan where there is "
            f"none; received {text!r}."
        ) from error


def _density(
    path: Path,
    depth: np.ndarray,
    temperature: np.ndarray,
    salinity: np.ndarray,
    *,
    potential: bool = False,
) -> np.ndarray:
    """In-situ density by TEOS-10, the salinity of reference composition."""
    try:
        import gsw
    except ImportError as error:
        raise ConfigError(
            f"{path}: density from temperature and salinity needs the package gsw: "
            "pip install 'jaxglider[data]'."
        ) from error
    pressure = gsw.p_from_z(-depth, 0.0)
    absolute = gsw.SR_from_SP(salinity)
    conservative = (
        gsw.CT_from_pt(absolute, temperature)
        if potential
        else gsw.CT_from_t(absolute, temperature, pressure)
    )
    return np.asarray(gsw.rho(absolute, conservative, pressure))


def _model_profile(path: Path, moment: Moment) -> tuple[np.ndarray, np.ndarray]:
    with opened(path) as data:
        one = at_time(path, at_place(path, data, moment), moment)
        salt = variable(path, one, ("so", "salinity", "s_an", "PSAL", "SALT"))
        warm = variable(
            path, one, ("thetao", "temperature", "t_an", "TEMP", "to", "THETA")
        )
        depth = depths(path, one)
        axis = [found(one, "depth")]
        potential = warm.name in ("thetao", "THETA") or "potential" in str(
            warm.attrs.get("standard_name", "")
        )
        values = [over(path, each, axis) for each in (warm, salt)]
        return depth, _density(path, depth, *values, potential=potential)
