"""The sea from files: places, courses, density, currents, the bottom, and OG-1.0."""

import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

from jaxglider.core.toml import ConfigError
from jaxglider.environment.tables import (
    CurrentTable,
    DensityProfile,
    SeabedGrid,
    bilinear,
)
from jaxglider.environment.water import Current, Stratification
from jaxglider.files.mission import build_mission
from jaxglider.files.sea.located import with_sea_inside
from jaxglider.files.sea.places import Plane
from jaxglider.files.sea.waypoint_files import read_waypoints
from jaxglider.signals import GliderState

KIEL = Plane(54.4, 10.2)
PLACES = [(54.41, 10.2), (54.41, 10.23), (54.4, 10.21)]
GPX = """<?xml version="1.0"?>
<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>
<rtept lat="54.41" lon="10.2"/><rtept lat="54.41" lon="10.23"><name>b</name></rtept>
<rtept lat="54.4" lon="10.21"/></rte></gpx>"""
LINE = "10.2,54.41,0 10.23,54.41,0\n 10.21,54.4,0"
POINTS = "".join(
    f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point></Placemark>"
    for lat, lon in PLACES
)
COLLECTION = json.dumps(
    {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": [lon, lat]},
            }
            for lat, lon in PLACES
        ],
    }
)
LINE_STRING = json.dumps(
    {"type": "LineString", "coordinates": [[lon, lat] for lat, lon in PLACES]}
)
GOTO = """behavior_name=goto_list
<start:b_arg>
    b_arg: num_waypoints(nodim) 3
<end:b_arg>
<start:waypoints>
 1012.000  5424.6000  # lon lat
 1013.800  5424.6000
 1012.600  5424.0000
<end:waypoints>
"""
COURSES = {
    "a.gpx": GPX,
    "b.gpx": GPX.replace("<rte>", "").replace("</rte>", "").replace("rtept", "wpt"),
    "c.gpx": GPX.replace("rtept", "trkpt")
    .replace("<rte>", "<trk><trkseg>")
    .replace("</rte>", "</trkseg></trk>"),
    "a.kml": f"<kml><LineString><coordinates>{LINE}</coordinates></LineString></kml>",
    "b.kml": f'<kml xmlns="http://www.opengis.net/kml/2.2">{POINTS}</kml>',
    "a.geojson": COLLECTION,
    "b.json": LINE_STRING,
    "a.csv": "name, lat, lon\na,54.41,10.2\nb,54.41,10.23\nc,54.4,10.21\n",
    "a.ma": GOTO,
}


@pytest.mark.parametrize("name", COURSES)
def test_courses_of_other_programs_are_the_same_places(tmp_path, name):
    (tmp_path / name).write_text(COURSES[name])
    found = np.array(read_waypoints(tmp_path / name))
    assert found == pytest.approx(np.array(PLACES), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("a.kmz", "", "must end in .gpx"),
        ("a.gpx", "<gpx>", "no XML"),
        ("a.gpx", " \n", r"a\.gpx is empty"),
        (
            "a.gpx",
            "<gpx/>",
            "no waypoint in it; it needs a route, waypoints or a track",
        ),
        (
            "a.gpx",
            GPX.replace("<gpx", "<gpx><rte><rtept/></rte><a").replace(
                "</gpx>", "</a></gpx>"
            ),
            "2 routes in it",
        ),
        ("a.geojson", "{", "no JSON"),
        ("a.geojson", '{"type": "Polygon", "features": null}', "needs a LineString"),
        ("a.geojson", '{"type": "LineString", "coordinates": 3}', "must be a list"),
        ("a.csv", "x,y\n1,2\n", "must name columns latitude and longitude"),
        ("a.csv", "# b\nlat,lon\n\n1,east\n", "lon in line 4 must be a number"),
        ("a.csv", "lat,lon\n1\n", "line 2 has 1 values; the first has 2 names"),
        ("a.csv", "lat,lon\n121.0,54.0\n", "Are the two swapped"),
        ("a.ma", "1 2\n", "between <start:waypoints>"),
        ("a.ma", GOTO.replace("5424.6000", "5464.6", 1), "it has 64.6 minutes"),
    ],
)
def test_a_course_that_is_none_is_refused(tmp_path, name, text, complaint):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_waypoints(tmp_path / name)


def test_the_plane_is_that_of_the_earth():
    # A minute of latitude at 54.4 N on WGS 84: M = a(1−e²)/(1−e² sin²φ)^1.5.
    a, e2, phi = 6378137.0, 0.00669437999014, math.radians(54.4)
    radius = a * (1 - e2) / (1 - e2 * math.sin(phi) ** 2) ** 1.5
    across = a / math.sqrt(1 - e2 * math.sin(phi) ** 2) * math.cos(phi)
    north, east = KIEL.metres(54.4 + 1 / 600, 10.2 + 1 / 600)
    assert float(north) == pytest.approx(radius * math.radians(1 / 600), abs=0.1)
    assert float(east) == pytest.approx(across * math.radians(1 / 600), abs=0.1)
    back = KIEL.degrees(30e3, -40e3)
    assert np.array(KIEL.metres(*back)) == pytest.approx([30e3, -40e3], abs=1e-3)


def mission(**tables):
    return {
        "initial_state": {"latitude_deg": 54.4, "longitude_deg": 10.2},
        "reference": {"type": "waypoints", "waypoints": tables.pop("waypoints", {})},
        **tables,
    }


def test_a_course_in_degrees_is_flown_in_metres(tmp_path):
    (tmp_path / "a.gpx").write_text(GPX)
    named = mission(waypoints={"file": "a.gpx", "radius_m": 50.0})
    typed = mission(
        waypoints={
            "latitude_deg": [p[0] for p in PLACES],
            "longitude_deg": [p[1] for p in PLACES],
            "radius_m": 50.0,
        }
    )
    expected = np.array(KIEL.metres(*zip(*PLACES, strict=True)))
    for data in (named, typed):
        whole = with_sea_inside(data, tmp_path)
        assert with_sea_inside(whole, tmp_path / "elsewhere") == whole
        path = whole["reference"]["waypoints"]
        found = np.array([path["north_m"], path["east_m"]])
        assert found == pytest.approx(expected, abs=1e-6)
        assert "file" in data["reference"]["waypoints"] or data is typed
    read = build_mission(named, tmp_path)
    assert np.asarray(read.loop.scenario.reference.north) == pytest.approx(
        expected[0], rel=1e-6
    )
    assert read.loop.scenario.origin.place == (54.4, 10.2)
    assert not read.loop.scenario.origin.moved
    assert not read.remarks
    away = mission(waypoints={"latitude_deg": [55.4], "longitude_deg": [10.2]})
    (said,) = build_mission(away).remarks
    assert "m away, too far for 800 s" in said


@pytest.mark.parametrize(
    ("tables", "complaint"),
    [
        ({"waypoints": {"file": "a.gpx", "north_m": [1.0]}}, "are both given"),
        ({"waypoints": {"latitude_deg": [54.4]}}, "longitude_deg is missing"),
        (
            {"waypoints": {"latitude_deg": [64.4], "longitude_deg": [10.0]}},
            "within 500 km",
        ),
        ({"initial_state": {"latitude_deg": 54.4}}, "longitude_deg is missing"),
        (
            {"initial_state": {"latitude_deg": 120.0, "longitude_deg": 54.0}},
            "Are the two swapped",
        ),
        (
            {
                "initial_state": {
                    "latitude_deg": 1.0,
                    "longitude_deg": 2.0,
                    "north_m": 3.0,
                }
            },
            "north_m and latitude_deg are both given",
        ),
        (
            {"initial_state": {}, "waypoints": {"file": "a.gpx"}},
            "needs initial_state.latitude_deg",
        ),
        ({"clock": {"start": "2024"}}, "clock.start must be a date"),
        ({"water": {"current": {"file": 3}}}, r"water\.current\.file must be a path"),
        ({"water": {"current": {"file": "no.nc"}}}, "no such file"),
        ({"seabed": {"file": "a.gpx"}}, "It must be NetCDF"),
        ({"seabed": {"file": "a.gpx", "grid": {}}}, "seabed.grid and seabed.file are"),
    ],
)
def test_places_that_cannot_be_are_refused(tmp_path, tables, complaint):
    (tmp_path / "a.gpx").write_text(GPX)
    with pytest.raises(ConfigError, match=complaint):
        with_sea_inside(mission(**tables), tmp_path)


def test_tables_are_linear_between_their_numbers():
    rows, columns = jnp.array([0.0, 1.0, 3.0]), jnp.array([10.0, 20.0])
    table = jnp.array([[1.0, 2.0], [3.0, 5.0], [7.0, 7.0]])

    @jax.jit
    @jax.vmap
    def look(row, column):
        return bilinear(row, column, rows, columns, table)

    found = look(
        jnp.array([0.0, 0.5, 2.0, -5.0, 9.0]), jnp.array([10.0, 15.0, 20.0, 5.0, 90.0])
    )
    assert np.asarray(found) == pytest.approx([1.0, 2.75, 6.0, 1.0, 7.0])
    slope = jax.grad(bilinear)(
        jnp.asarray(2.0), jnp.asarray(15.0), rows, columns, table
    )
    assert float(slope) == pytest.approx((7.0 - 4.0) / 2.0)


def test_water_of_tables_is_added_to_that_of_numbers():
    model = CurrentTable([0, 100], [0, 50], [[0, 0.1], [0.2, 0.3]], [[0, 0], [1, 1]])
    north, east = Current(north=1.0, table=model).velocity(
        jnp.asarray(25.0), jnp.asarray(50.0)
    )
    assert (float(north), float(east)) == pytest.approx((1.15, 0.5))
    profile = DensityProfile([0.0, 10.0, 100.0], [1000.0, 1010.0, 1020.0])
    water = Stratification(50.0, 0.0, 4e-6, 10.0, profile)
    # m (κ z − Δρ/ρ₀ (1 − κ z)), with the density of the table.
    squeezed, dense = 4e-6 * 90.0, 10.0 / 1010.0
    expected = 50.0 * (squeezed - dense * (1 - squeezed))
    assert float(water.excess_mass(jnp.asarray(100.0))) == pytest.approx(
        expected, rel=1e-6
    )
    bed = SeabedGrid([0.0, 100.0], [0.0, 100.0], [[10.0, 10.0], [30.0, 30.0]])
    state = GliderState.at_rest(north=50.0, east=70.0, depth=4.0)
    assert float(bed.altitude(state)) == pytest.approx(16.0)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: DensityProfile([0.0, 0.0], [1.0, 2.0]), "depth must rise"),
        (lambda: DensityProfile([0.0], [1.0]), "at least 2"),
        (lambda: CurrentTable([0, 1], [0, 1], [[0, 0]], [[0, 0]]), "shape"),
    ],
)
def test_tables_that_are_none_are_refused(make, complaint):
    with pytest.raises(ValueError, match=complaint):
        make()


def ocean(path, first="2024-05-01", days=1, change=lambda data: data):
    """An ocean model's file: v = latitude + step, u = depth, as Copernicus has it."""
    stamps = np.datetime64(first) + np.arange(3) * np.timedelta64(days, "D")
    latitude, longitude = np.array([54.0, 55.0]), np.array([10.0, 11.0])
    depth = np.array([0.5, 10.0, 100.0])
    shape = (3, 3, 2, 2)
    north = (latitude[:, None] - 54.4 + np.zeros((3, 3, 2, 2))) + (
        0.1 * np.arange(3)[:, None, None, None]
    )
    east = np.broadcast_to(0.01 * depth[:, None, None], shape).copy()
    north[:, 2], east[:, 2] = np.nan, np.nan
    axes = ("time", "depth", "latitude", "longitude")
    data = {
        "vo": (axes, north),
        "uo": (axes, east),
        "thetao": (axes, np.full(shape, 8.0)),
        "so": (axes, np.broadcast_to(10.0 + 0.1 * depth[:, None, None], shape)),
    }
    places = {
        "time": stamps.astype("datetime64[ns]"),
        "depth": depth,
        "latitude": latitude,
        "longitude": longitude,
    }
    change(xarray.Dataset(data, places)).to_netcdf(path)


START = {"clock": {"start": np.datetime64("2024-05-01T12:00").astype(object)}}


def test_currents_of_an_ocean_model_are_those_at_the_start(tmp_path):
    ocean(tmp_path / "cmems.nc")
    data = mission(water={"current": {"file": "cmems.nc", "east_m_s": 0.5}}, **START)
    table = with_sea_inside(data, tmp_path)["water"]["current"]["table"]
    # Bilinear in latitude; the deepest level is under the bottom there.
    assert table["depth_m"] == [0.5, 10.0]
    assert table["time_s"] == pytest.approx([-43200.0, 43200.0, 129600.0])
    assert np.array(table["north_m_s"])[:, 0] == pytest.approx([0.0, 0.1, 0.2])
    assert np.array(table["east_m_s"])[0] == pytest.approx([0.005, 0.1])
    data["reference"] = {"type": "schedule"}
    current = build_mission(data, tmp_path).loop.scenario.water.current
    assert float(
        current.velocity(jnp.asarray(10.0), jnp.asarray(0.0))[1]
    ) == pytest.approx(0.6)


def test_currents_of_months_are_kept_around_the_start(tmp_path):
    ocean(tmp_path / "months.nc", first="2024-04-16", days=31)
    data = mission(water={"current": {"file": "months.nc"}}, **START)
    table = with_sea_inside(data, tmp_path)["water"]["current"]["table"]
    assert np.array(table["time_s"]) / 86400.0 == pytest.approx([-15.5, 15.5, 46.5])
    assert np.array(table["north_m_s"])[:, 0] == pytest.approx([0.0, 0.1, 0.2])


def curved(data):
    """The grid of a model whose axes are no latitudes and longitudes."""
    two = np.meshgrid(data.latitude, data.longitude, indexing="ij")
    bare = data.rename(latitude="y", longitude="x").drop_vars(["y", "x"])
    return bare.assign_coords(
        nav_lat=(("y", "x"), two[0]), nav_lon=(("y", "x"), two[1])
    )


@pytest.mark.parametrize("table", ["stratification", "current"])
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (curved, "nav_lat must be an axis of the grid; it goes over y, x"),
        (lambda d: d.isel(depth=[2, 1, 0]), "depth must rise from the surface down"),
        (lambda d: d.expand_dims(member=2), "goes over member too"),
        (lambda d: d[["so"]], "none of the variables"),
        (lambda d: d.assign_coords(time=[1, 2, 3]), "time must be in seconds, hours"),
    ],
)
def test_files_of_another_form_are_refused(tmp_path, table, change, complaint):
    ocean(tmp_path / "cmems.nc", change=change)
    data = mission(water={table: {"file": "cmems.nc"}}, **START)
    with pytest.raises(ConfigError, match=rf"cmems\.nc.*{complaint}"):
        with_sea_inside(data, tmp_path)


@pytest.mark.parametrize("table", ["stratification", "current"])
@pytest.mark.parametrize(
    ("tables", "complaint"),
    [
        ({}, "give the date of the start"),
        ({"clock": {"start": np.datetime64("2025-05-01").astype(object)}}, "date"),
        (
            {"clock": {"start": np.datetime64("2025-05-01T00").astype(object)}},
            "must lie in between",
        ),
        (
            {"initial_state": {"latitude_deg": 50.0, "longitude_deg": 10.5}, **START},
            "latitude goes from 54 to 55",
        ),
    ],
)
def test_water_of_elsewhere_is_refused(tmp_path, table, tables, complaint):
    ocean(tmp_path / "cmems.nc")
    data = mission(water={table: {"file": "cmems.nc"}}) | tables
    with pytest.raises(ConfigError, match=complaint):
        with_sea_inside(data, tmp_path)


def test_density_profiles_of_files(tmp_path):
    (tmp_path / "ctd.csv").write_text(
        "# a cast\ndepth_m, density_kg_m3\n20,1012\n0,1005\n20,1012\n"
    )
    data = mission(water={"stratification": {"file": "ctd.csv"}})
    table = with_sea_inside(data, tmp_path)["water"]["stratification"]["profile"]
    assert table == {"depth_m": [0.0, 20.0], "density_kg_m3": [1005.0, 1012.0]}
    gsw = pytest.importorskip("gsw")
    ocean(tmp_path / "model.nc")
    data = mission(water={"stratification": {"file": "model.nc"}}, **START)
    table = with_sea_inside(data, tmp_path)["water"]["stratification"]["profile"]
    salt = gsw.SR_from_SP(20.0)
    expected = gsw.rho(salt, gsw.CT_from_pt(salt, 8.0), gsw.p_from_z(-100.0, 0.0))
    assert table["density_kg_m3"][-1] == pytest.approx(expected, abs=1e-6)


def test_a_climatology_of_months_needs_no_date(tmp_path):
    gsw = pytest.importorskip("gsw")

    def one_month(data):
        units = {"units": "months since 1955-01-01 00:00:00"}
        named = data.isel(time=[0]).rename(so="s_an", thetao="t_an")
        return named.assign_coords(time=("time", [5.5], units))

    ocean(tmp_path / "woa.nc", change=one_month)
    data = mission(water={"stratification": {"file": "woa.nc"}})
    table = with_sea_inside(data, tmp_path)["water"]["stratification"]["profile"]
    salt, pressure = gsw.SR_from_SP(20.0), gsw.p_from_z(-100.0, 0.0)
    expected = gsw.rho(salt, gsw.CT_from_t(salt, 8.0, pressure), pressure)
    assert table["density_kg_m3"][-1] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("depth_m,sigma\n0,5\n", "must name depth_m and density_kg_m3"),
        ("depth_m,density_kg_m3\n0,5\n10,7\n", "Anomalies"),
        ("depth_m,density_kg_m3\n0,1005\n", "two depths"),
        ("depth_m,density_kg_m3\n", "two depths"),
        ("depth_m,density_kg_m3\n0,\n", "density_kg_m3 in line 2 must be a number"),
        ("depth_m,density_kg_m3\n-9,1007\n0,1005\n", "depth must be positive down"),
    ],
)
def test_profiles_that_are_none_are_refused(tmp_path, text, complaint):
    (tmp_path / "ctd.csv").write_text(text)
    data = mission(water={"stratification": {"file": "ctd.csv"}})
    with pytest.raises(ConfigError, match=complaint):
        with_sea_inside(data, tmp_path)


def test_the_bottom_of_a_grid(tmp_path):
    latitude, longitude = np.linspace(53.0, 56.0, 31), np.linspace(9.0, 12.0, 31)
    rise = -(20.0 + 10.0 * (latitude[:, None] - 54.4) + 0.0 * longitude)
    xarray.Dataset(
        {"elevation": (("lat", "lon"), rise)}, {"lat": latitude, "lon": longitude}
    ).to_netcdf(tmp_path / "gebco.nc")
    data = mission(seabed={"file": "gebco.nc"})
    data["reference"] = {"type": "schedule"}
    seabed = build_mission(data, tmp_path).loop.scenario.seabed
    there = seabed.altitude(GliderState.at_rest(north=11130.0, east=5000.0))
    assert float(there) == pytest.approx(21.0, abs=0.02)


def test_a_bottom_across_the_date_line(tmp_path):
    latitude, longitude = np.linspace(53.0, 56.0, 31), np.linspace(160.0, 220.0, 601)
    deep = 1000.0 + 100.0 * (longitude - 180.0) + 0.0 * latitude[:, None]
    xarray.Dataset(
        {"deptho": (("latitude", "longitude"), deep)},
        {"latitude": latitude, "longitude": longitude},
    ).to_netcdf(tmp_path / "pacific.nc")
    for start, place in ((179.95, -5.0), (-179.95, 5.0)):
        data = mission(seabed={"file": "pacific.nc"}) | {
            "initial_state": {"latitude_deg": 54.4, "longitude_deg": start}
        }
        grid = with_sea_inside(data, tmp_path)["seabed"]["grid"]
        along = np.array(grid["depth_m"])[60]
        assert along[60] == pytest.approx(1000.0 + place, abs=1e-6)
        # 100 m for each degree of 64.98 km.
        assert along[-1] - along[0] == pytest.approx(100.0 * 60e3 / 64.98e3, rel=1e-3)
