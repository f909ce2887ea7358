"""Places on Earth in the plane that a mission is flown in.

The plane is the azimuthal equidistant projection about the start (WGS 84, by the
package pyproj): from there distances and directions are those on Earth. Between two
other places they are off by d²/(6 R²) of themselves, 4 m in 100 km; and the plane's
north is that of the start's meridian.
"""

import dataclasses
import functools
import math
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError

FARTHEST = 500e3
"""Largest distance from the start [m] that the plane serves: it is off by 0.1 %."""


@dataclasses.dataclass(frozen=True)
class Plane:
    """The plane around a place.

    Attributes:
        latitude: latitude of its zero [deg], positive north.
        longitude: longitude of its zero [deg], positive east.
    """

    latitude: float
    longitude: float

    def metres(self, latitude: Any, longitude: Any) -> tuple[np.ndarray, np.ndarray]:
        """North and east [m] of places.

        Args:
            latitude: latitudes [deg].
            longitude: longitudes [deg].
        """
        east, north = _projection(self)(
            np.asarray(longitude, float), np.asarray(latitude, float)
        )
        return np.asarray(north), np.asarray(east)

    def degrees(self, north: Any, east: Any) -> tuple[np.ndarray, np.ndarray]:
        """Latitudes and longitudes [deg] of places in the plane.

        Args:
            north: distances north of its zero [m].
            east: distances east of its zero [m].
        """
        longitude, latitude = _projection(self)(
            np.asarray(east, float), np.asarray(north, float), inverse=True
        )
        return np.asarray(latitude), np.asarray(longitude)


@functools.lru_cache(maxsize=8)
def _projection(plane: Plane) -> Any:
    try:
        import pyproj
    except ImportError as error:
        raise ConfigError(
            "latitudes and longitudes need the package pyproj: "
            "pip install 'jaxglider[geo]'."
        ) from error
    return pyproj.Proj(
        proj="aeqd", lat_0=plane.latitude, lon_0=plane.longitude, ellps="WGS84"
    )


def checked(latitude: float, longitude: float, where: str) -> tuple[float, float]:
    """A latitude and a longitude in [−180, 180) [deg].

    Args:
        latitude: latitude [deg].
        longitude: longitude [deg], from −180 to 360.
        where: place in a file that they come from, for the message.

    Raises:
        ConfigError: they are no place on Earth.
    """
    if not (abs(latitude) <= 90.0 and -180.0 <= longitude <= 360.0):
        swapped = abs(longitude) <= 90.0 < abs(latitude) <= 360.0
        hint = " Are the two swapped?" if swapped else ""
        raise ConfigError(
            f"{where} must be a latitude from -90 to 90 and a longitude from -180 to "
            f"360, in decimal degrees; received {latitude:g}, {longitude:g}.{hint}"
        )
    return latitude, (longitude + 180.0) % 360.0 - 180.0


def within(north: np.ndarray, east: np.ndarray, where: str) -> None:
    """Refuse places that are too far from the start for one plane.

    Args:
        north: distances north of the start [m].
        east: distances east of the start [m].
        where: place in a file that they come from, for the message.

    Raises:
        ConfigError: one is.
    """
    far = float(np.max(np.hypot(north, east), initial=0.0))
    if not far <= FARTHEST or not math.isfinite(far):
        raise ConfigError(
            f"{where} must lie within {FARTHEST / 1e3:g} km of initial_state, where "
            f"one plane is near enough to the Earth; one is {far / 1e3:.4g} km away. "
            "Is its longitude positive east? Longer missions are flown in parts."
        )
