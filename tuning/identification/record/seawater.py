"""Density of sea water, and depth from pressure.

Density is that of TEOS-10 (IOC, SCOR and IAPSO 2010), by the package gsw, in the
optional extra `data`. Depth needs no package: z = p/(ρ g), ρ the record's own mean.
"""

import dataclasses
from typing import Any

import numpy as np

from tuning.identification.record.flight_record import Finding, FlightRecord, Series

STANDARD = 1025.0
"""Density of sea water [kg/m³] where the record has none."""
GRAVITY = 9.81
"""Acceleration by which pressure is turned into depth [m/s²]."""


def with_density(record: FlightRecord) -> FlightRecord:
    """A record with in-situ density, from conductivity or salinity where it lacks it.

    In the Baltic Sea gsw itself takes the anomaly of salinity there by the position.

    Args:
        record: cleaned record.
    """
    if record.has("density"):
        return record
    salt = "conductivity" if record.has("conductivity") else "salinity"
    if not record.has(salt, "temperature", "pressure"):
        return record
    gsw = _gsw()
    if gsw is None:
        return record.with_findings(
            [
                Finding(
                    "density",
                    "conductivity and temperature are there, the package gsw is not: "
                    "pip install 'jaxglider[data]'.",
                    warning=True,
                )
            ]
        )
    base = record.channels[salt]

    def on(name: str, default: float = 0.0) -> np.ndarray:
        if not record.has(name):
            return np.full(len(base), default)
        series = record.channels[name]
        return np.interp(base.time, series.time, series.values)

    pressure, temperature = on("pressure") / 1e4, on("temperature")
    practical = base.values
    if salt == "conductivity":
        practical = gsw.SP_from_C(10.0 * base.values, temperature, pressure)
    latitude = np.degrees(on("latitude"))
    longitude = np.degrees(on("longitude"))
    absolute = (
        gsw.SA_from_SP(practical, pressure, longitude, latitude)
        if record.has("latitude", "longitude")
        else gsw.SR_from_SP(practical)
    )
    potential = gsw.CT_from_t(absolute, temperature, pressure)
    density = gsw.rho(absolute, potential, pressure)
    good = np.isfinite(density) & (practical > 0.1)
    found = [Finding("density", f"TEOS-10 from {salt}, temperature and pressure.")]
    if not record.has("latitude", "longitude"):
        found.append(Finding("density", "no position: reference composition of salt."))
    series = Series(base.time[good], np.asarray(density)[good])
    channels = {**record.channels, "density": series}
    return dataclasses.replace(record, channels=channels).with_findings(found)


def _gsw() -> Any:
    try:
        import gsw
    except ImportError:
        return None
    return gsw


def mean_density(record: FlightRecord) -> float:
    """Mean density of the water [kg/m³]; the standard one where it was not measured."""
    if not record.has("density"):
        return STANDARD
    return float(np.mean(record.channels["density"].values))
