"""Variables of OG-1.0: what a simulated glider would have recorded, in its units.

Attitude, depth and positions are those of the sensors and of dead reckoning where the
glider has instruments, else the true ones.
"""

import dataclasses
import datetime
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.places import Plane
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.scenario import Scenario

EPOCH = datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC)
"""Date that stands for the start of a mission without one."""
DENSITY = 1025.0
"""Density of the water [kg/m³] at neutral depth, where no profile of it is given."""
AFLOAT = 0.5
"""Depth [m] above which a glider without a receiver of its own has a position."""
EVERY = 1.0
"""Shortest time between samples that are written [s]."""
_SECONDS = "seconds since 1970-01-01T00:00:00Z"


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of the file.

    Attributes:
        unit: unit.
        text: description.
        standard_name: name in CF's table, or an empty text.
        term: term of the OG1 vocabulary, or an empty text.
        low: smallest valid value, or None.
        high: largest valid value, or None.
    """

    unit: str
    text: str
    standard_name: str = ""
    term: str = ""
    low: float | None = None
    high: float | None = None


_PLACE = ("degrees_north", "degrees_east")
VARIABLES = {
    "TIME": Variable(_SECONDS, "time of measurement", "time", "TIME", 1e9, 4e9),
    "LATITUDE": Variable(_PLACE[0], "latitude", "latitude", "LAT", -90.0, 90.0),
    "LONGITUDE": Variable(_PLACE[1], "longitude", "longitude", "LON", -180.0, 180.0),
    "DEPTH": Variable("m", "depth below the surface", "depth", "DEPTH", 0.0, 1e4),
    "TIME_GPS": Variable(_SECONDS, "time of each fix", "time", "", 1e9, 4e9),
    "LATITUDE_GPS": Variable(
        _PLACE[0], "latitude of each fix", "latitude", "", -90.0, 90.0
    ),
    "LONGITUDE_GPS": Variable(
        _PLACE[1], "longitude of each fix", "longitude", "", -180.0, 180.0
    ),
    "PRES": Variable(
        "dbar", "pressure above that of the air", "sea_water_pressure", "PRES"
    ),
    "DENSITY": Variable(
        "kg m-3", "density of the water in situ", "sea_water_density", "DENSITY"
    ),
    "PITCH": Variable("degree", "pitch, nose up", "platform_pitch_fore_up"),
    "ROLL": Variable("degree", "roll, starboard down", "platform_roll_starboard_down"),
    "HEADING": Variable(
        "degree", "heading, clockwise from true north", "platform_yaw_fore_starboard"
    ),
    "VBD_CC": Variable("cm3", "volume of ballast, more of it rises"),
    "PITCH_CTL": Variable("cm", "moving mass along the axis, forward"),
    "ROLL_CTL": Variable("degree", "roll angle of the moving mass"),
}
"""Variables over the measurements, in order."""


def refuse_nowhere(scenario: Scenario) -> tuple[float, float]:
    """Latitude and longitude of the start [deg].

    Args:
        scenario: scenario of a mission.

    Raises:
        ConfigError: the mission is nowhere on Earth.
    """
    if scenario.origin.place is None:
        raise ConfigError(
            "OG-1.0 needs places on Earth: give initial_state.latitude_deg and "
            "longitude_deg in the mission."
        )
    return scenario.origin.place


def og1_columns(
    run: Trajectory, scenario: Scenario, start: datetime.datetime | None
) -> dict[str, np.ndarray]:
    """The variables of a flight over its measurements, in the units of the file.

    Args:
        run: trajectory on the host.
        scenario: scenario that it was flown in.
        start: date of the start; `EPOCH` if None.

    Raises:
        ConfigError: the mission is nowhere on Earth.
    """
    place = refuse_nowhere(scenario)
    ticks = run.ticks
    time = np.asarray(ticks.time, float)
    dt = float(np.median(np.diff(time))) if len(time) > 1 else EVERY
    rows = np.flatnonzero(np.asarray(ticks.active))[:: max(round(EVERY / dt), 1)]
    known = ticks.onboard
    state = ticks.state if known is None else known.estimate
    shown = ticks.state if known is None else known.shown

    def at(values: Any) -> np.ndarray:
        return np.asarray(values, float)[rows]

    north, east = at(state.north), at(state.east)
    plane = Plane(*place)
    latitude, longitude = plane.degrees(north, east)
    clock = (start or EPOCH).timestamp() + time[rows]
    fix, when = _fixes(ticks, rows, clock)
    depth = np.maximum(at(shown.depth), 0.0)
    neutral = _neutral_density(scenario)
    gravity = float(scenario.plant.parameters.gravity)
    applied = ticks.applied
    degree = 180.0 / np.pi
    fixed = plane.degrees(*fix)
    return {
        "TIME": clock,
        "LATITUDE": latitude,
        "LONGITUDE": longitude,
        "DEPTH": depth,
        "TIME_GPS": when,
        "LATITUDE_GPS": np.where(np.isfinite(when), fixed[0], np.nan),
        "LONGITUDE_GPS": np.where(np.isfinite(when), fixed[1], np.nan),
        "PRES": depth * neutral * gravity / 1e4,
        "DENSITY": neutral * (1.0 + _denser(scenario, at(ticks.state.depth))),
        "PITCH": degree * at(shown.pitch),
        "ROLL": degree * at(shown.roll),
        "HEADING": np.mod(degree * at(shown.heading), 360.0),
        "VBD_CC": -at(applied.buoyancy_mass) / neutral * 1e6,
        "PITCH_CTL": 1e2 * at(applied.mass_position),
        "ROLL_CTL": degree * at(applied.mass_angle),
    }


def _neutral_density(scenario: Scenario) -> float:
    """Density of the water [kg/m³] at neutral depth."""
    layers = scenario.water and scenario.water.stratification
    if not layers or layers.profile is None:
        return DENSITY
    profile = layers.profile
    return float(jnp.interp(layers.neutral_depth, profile.depth, profile.density))


def _denser(scenario: Scenario, depth: np.ndarray) -> np.ndarray:
    """Density at true depths [m] relative to that at neutral depth, less one."""
    layers = scenario.water and scenario.water.stratification
    if not layers:
        return np.zeros(len(depth))
    return np.asarray(jax.vmap(layers.denser)(jnp.asarray(depth)), float)


def _fixes(
    ticks: Any, rows: np.ndarray, clock: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """North and east [m] of the fixes, zero where none, and their times, else NaN.

    A fix between two rows stands in the later one.
    """
    if ticks.onboard is None:
        afloat = np.asarray(ticks.state.depth)[rows] < AFLOAT
        places = [
            np.asarray(x, float)[rows] for x in (ticks.state.north, ticks.state.east)
        ]
    else:
        fix = [np.asarray(x, float) for x in ticks.onboard.fix]
        last = np.maximum.accumulate(
            np.where(np.isfinite(fix[0]), np.arange(len(fix[0])), -1)
        )[rows]
        afloat = last > np.concatenate([[-1], rows[:-1]])
        places = [np.where(afloat, x[np.maximum(last, 0)], 0.0) for x in fix]
    north, east = (np.where(afloat, x, 0.0) for x in places)
    return (north, east), np.where(afloat, clock, np.nan)
