"""Courses as other programs write them: latitudes and longitudes in order.

| ending | what is read |
|---|---|
| .gpx | the route; without one, the waypoints; without these, the track |
| .kml | the line; without one, the placemarks that are points |
| .geojson, .json | a LineString or MultiPoint, or a collection of Points |
| .csv | columns latitude and longitude, or lat and lon, in decimal degrees |
| .ma | a Slocum's goto list: longitude and latitude as degrees and minutes, DDMM.mmm |
"""

import csv
import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from jaxglider.core.toml import ConfigError, file_text
from jaxglider.files.sea.places import checked

Place = tuple[float, float]
"""Latitude and longitude [deg]."""


def read_waypoints(path: Path) -> list[Place]:
    """The places of a course file, in order.

    Args:
        path: path of the file.

    Raises:
        ConfigError: it is of no known kind, holds no one course, or no places on Earth.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ConfigError(
            f"a course file must end in {', '.join(_READERS)}; received {path.name!r}."
        )
    try:
        text = file_text(path)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from error
    try:
        places = list(reader(text))
    except _Unreadable as error:
        raise ConfigError(f"{path}: {error}.") from error
    if not places:
        raise ConfigError(f"{path}: no waypoint in it.")
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


def _gpx(text: str) -> Iterable[Place]:
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


def _kml(text: str) -> Iterable[Place]:
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


def _geojson(text: str) -> Iterable[Place]:
    try:
        data = json.loads(text)
    except ValueError as error:
        raise _Unreadable(f"no JSON: {error}") from error
    found: dict[str, list[Any]] = {"LineString": [], "MultiPoint": [], "Point": []}

    def look(item: Any) -> None:
        if not isinstance(item, dict):
            return
        for part in (*item.get("features", ()), *item.get("geometries", ())):
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


def _csv(text: str) -> Iterable[Place]:
    lines = [line for line in text.splitlines() if line.strip() and line[0] != "#"]
    rows = list(csv.DictReader(lines, skipinitialspace=True))
    names = {name.strip().lower(): name for name in (rows[0] if rows else {}) if name}
    head = next((h for h in _HEADS if h[0] in names and h[1] in names), None)
    if head is None:
        raise _Unreadable(
            "its first line must name columns latitude and longitude; received "
            f"{', '.join(names) or 'nothing'}"
        )
    return [
        tuple(_number(row[names[key]], f"{key} in line {n}") for key in head)  # type: ignore[misc]
        for n, row in enumerate(rows, 2)
    ]


def _goto(text: str) -> Iterable[Place]:
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


_READERS: dict[str, Callable[[str], Iterable[Place]]] = {
    ".gpx": _gpx,
    ".kml": _kml,
    ".geojson": _geojson,
    ".json": _geojson,
    ".csv": _csv,
    ".ma": _goto,
}
