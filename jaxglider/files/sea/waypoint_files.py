"""Courses as other programs write them: latitudes and longitudes in order.

| ending | what is read |
|---|---|
| .gpx | the route; without one, the waypoints; without these, the track |
| .kml | the line; without one, the placemarks that are points |
| .geojson, .json | a LineString or MultiPoint, or a collection of Points |
| .csv | columns latitude and longitude, or lat and lon, in decimal degrees |
| .ma | a Slocum's goto list: longitude and latitude as degrees and minutes, DDMM.mmm |
"""

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.places import checked
from jaxglider.files.sea.texts import csv_table, text_of

Place = tuple[float, float]
"""Latitude and longitude [deg]."""


def read_waypoints(path: Path) -> list[Place]:
    """The places of a course file, in order.

    Args:
        path: path of the file.

    Raises:
        ConfigError: it is of no known kind, holds no one course, or no places on Earth.
    """
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise ConfigError(
            f"a course file must end in {', '.join(_READERS)}; received {path.name!r}."
        )
    reader, needs = _READERS[kind]
    text = text_of(path)
    try:
        places = list(reader(path, text))
    except _Unreadable as error:
        raise ConfigError(f"{path}: {error}.") from error
    if not places:
        raise ConfigError(f"{path}: no waypoint in it; it needs {needs}.")
    return [
        checked(latitude, longitude, f"{path}: waypoint {n}")
        for n, (latitude, longitude) in enumerate(places, 1)
    ]


class _Unreadable(ValueError):
    """Text of a course file that cannot be read."""


def _number(text: Any, what: str) -> float:
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise _Unreadable(f"{what} must be a number; received {text!r}")
    return value


def _tree(text: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise _Unreadable(f"no XML: {error}") from error


def _named(root: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    """Elements of a name in whatever namespace."""
    return [e for e in root.iter() if e.tag.rpartition("}")[2] == name]


def _only(lines: list[Any], what: str) -> Any:
    if len(lines) > 1:
        raise _Unreadable(
            f"{len(lines)} {what}s in it; keep the one that is to be flown"
        )
    return lines[0]


def _gpx(_path: Path, text: str) -> Iterable[Place]:
    root = _tree(text)
    routes = [r for r in _named(root, "rte") if _named(r, "rtept")]
    tracks = [t for t in _named(root, "trk") if _named(t, "trkpt")]
    if routes:
        points = _named(_only(routes, "route"), "rtept")
    elif not (points := _named(root, "wpt")) and tracks:
        points = _named(_only(tracks, "track"), "trkpt")
    return [
        (_number(p.get("lat"), "lat"), _number(p.get("lon"), "lon")) for p in points
    ]


def _kml(_path: Path, text: str) -> Iterable[Place]:
    root = _tree(text)
    if lines := _named(root, "LineString"):
        groups = [_only(lines, "line")]
    else:
        groups = _named(root, "Point")
    cells = [
        cell
        for group in groups
        for holder in _named(group, "coordinates")
        for cell in (holder.text or "").split()
    ]
    return [_lon_lat(cell.split(",")) for cell in cells]


def _lon_lat(pair: Any) -> Place:
    if not isinstance(pair, list) or len(pair) < 2:
        raise _Unreadable(f"coordinates must be longitude, latitude; received {pair!r}")
    return _number(pair[1], "latitude"), _number(pair[0], "longitude")


_OF_GEOJSON = "a LineString, a MultiPoint or Points"


def _geojson(_path: Path, text: str) -> Iterable[Place]:
    try:
        data = json.loads(text)
    except ValueError as error:
        raise _Unreadable(f"no JSON: {error}") from error
    found: dict[str, list[Any]] = {"LineString": [], "MultiPoint": [], "Point": []}

    def look(item: Any) -> None:
        if not isinstance(item, dict):
            return
        for key in ("features", "geometries"):
            parts = item.get(key)
            for part in parts if isinstance(parts, list) else ():
                look(part)
        look(item.get("geometry"))
        if item.get("type") in found:
            found[item["type"]].append(item.get("coordinates"))

    look(data)
    lines = found["LineString"] + found["MultiPoint"]
    pairs = _only(lines, "line") if lines else found["Point"]
    if not isinstance(pairs, list):
        raise _Unreadable(f"coordinates must be a list; received {pairs!r}")
    return [_lon_lat(pair) for pair in pairs]


_HEADS = (("latitude", "longitude"), ("lat", "lon"), ("latitude_deg", "longitude_deg"))


def _csv(path: Path, text: str) -> Iterable[Place]:
    head, rows = csv_table(path, text)
    names = {name.lower(): name for name in head}
    keys = next((h for h in _HEADS if h[0] in names and h[1] in names), None)
    if keys is None:
        raise _Unreadable(
            "its first line must name columns latitude and longitude; received "
            f"{', '.join(head)}"
        )
    latitude, longitude = keys
    return [
        (
            _number(row[names[latitude]], f"{latitude} in line {n}"),
            _number(row[names[longitude]], f"{longitude} in line {n}"),
        )
        for n, row in rows
    ]


def _goto(_path: Path, text: str) -> Iterable[Place]:
    _, begun, rest = text.partition("<start:waypoints>")
    inside, ended, _ = rest.partition("<end:waypoints>")
    if not begun or not ended:
        raise _Unreadable(
            "a goto list has waypoints between <start:waypoints> and <end:waypoints>"
        )
    places = []
    for line in inside.splitlines():
        cells = line.partition("#")[0].split()
        if not cells:
            continue
        if len(cells) != 2:
            raise _Unreadable(f"a waypoint is a longitude and a latitude: {line!r}")
        longitude, latitude = (_minutes(cell) for cell in cells)
        places.append((latitude, longitude))
    return places


def _minutes(cell: str) -> float:
    """Decimal degrees of DDMM.mmm."""
    value = _number(cell, "a waypoint")
    degrees, minutes = divmod(abs(value), 100.0)
    if minutes >= 60.0:
        raise _Unreadable(f"{cell} is no DDMM.mmm: it has {minutes:g} minutes")
    return math.copysign(degrees + minutes / 60.0, value)


_READERS: dict[str, tuple[Callable[[Path, str], Iterable[Place]], str]] = {
    ".gpx": (_gpx, "a route, waypoints or a track"),
    ".kml": (_kml, "a line or placemarks that are points"),
    ".geojson": (_geojson, _OF_GEOJSON),
    ".json": (_geojson, _OF_GEOJSON),
    ".csv": (_csv, "a row for each"),
    ".ma": (_goto, "a longitude and a latitude in a line"),
}
"""Reader by the ending of a file, and what it looks for."""
