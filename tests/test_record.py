"""Readers of flight records: units, signs, gaps, faults, against what was written."""

import gzip
import json

import numpy as np
import pytest
import xarray

from tuning.identification.record.cleaning import clean
from tuning.identification.record.flight_record import FlightRecord, Series
from tuning.identification.record.reading import read_record
from tuning.identification.record.seawater import with_density
from tuning.identification.record.slopes import kernel
from tuning.identification.record.uniform import missing_for, uniform

TIME = np.arange(0.0, 3600.0, 4.0)
DEPTH = 40.0 * np.abs(((TIME / 600.0) % 2.0) - 1.0)
DEPTH = 40.0 - DEPTH
RATE = np.gradient(DEPTH, TIME)
PITCH = -0.4 * np.sign(RATE)


def record(**changed):
    channels = {
        "depth": Series(TIME, DEPTH),
        "pitch": Series(TIME, PITCH),
        "ballast": Series(TIME, -2e-4 * np.sign(RATE)),
        "density": Series(TIME, np.full(len(TIME), 1025.0)),
    }
    channels |= {k: Series(TIME, v) for k, v in changed.items()}
    return FlightRecord("made", "made", channels)


def texts(found):
    return " ".join(f"{f.channel}: {f.text}" for f in found.findings)


def test_gliderflight_table_in_si_units(tmp_path):
    table = np.array([TIME, DEPTH / 10.0, PITCH, 230 * PITCH, 1025 + 0 * TIME, TIME])
    table[5] = np.where(np.arange(len(TIME)) % 3, np.nan, 0.3)
    np.save(tmp_path / "flight.npy", table)
    found = read_record(tmp_path / "flight.npy")
    assert found.channels["pressure"].values.max() == pytest.approx(DEPTH.max() * 1e4)
    assert found.channels["ballast"].values[0] == pytest.approx(230e-6 * PITCH[0])
    assert len(found.channels["speed"]) == len(TIME[::3])
    assert len(found.digest) == 64


GLI = (
    "Timestamp;Heading;Declination;Pitch;Roll;Depth;Lat;Lon;DesiredH;BallastPos;"
    "LinPos;AngPos;\n"
)


def sea_explorer(folder, zipped=False):
    rows = [
        f"01/02/2020 00:{m:02d}:{s:02d};350.0;16;-20.0;5.0;{10 + m}.0;4830.000;"
        f"-13030.000;10;-200.0;60.0;-30.0;\n"
        for m in range(3)
        for s in (0, 20, 40)
    ]
    text = GLI + "".join(rows)
    if zipped:
        path = folder / "sea.1.gli.sub.1.gz"
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path = folder / "sea.1.gli.sub.1"
        path.write_text(text)
    payload = folder / "sea.1.pld1.sub.1"
    payload.write_text(
        "PLD_REALTIMECLOCK;GPCTD_CONDUCTIVITY;GPCTD_TEMPERATURE;GPCTD_PRESSURE;\n"
        + "".join(
            f"01/02/2020 00:{m:02d}:30.250;{c};10.0;9999.00;\n"
            for m, c in ((0, 3.5), (1, 0.0), (2, 3.6))
        )
    )
    return path, payload


@pytest.mark.parametrize("zipped", [False, True])
def test_seaexplorer_in_si_units(tmp_path, zipped):
    found = read_record(sea_explorer(tmp_path, zipped))
    value = {name: s.values[0] for name, s in found.channels.items()}
    assert value["pitch"] == pytest.approx(np.radians(-20.0))
    assert value["heading"] == pytest.approx(np.radians(-10.0))
    assert value["ballast"] == pytest.approx(-2e-4)
    assert value["mass_position"] == pytest.approx(0.06)
    assert value["latitude"] == pytest.approx(np.radians(48.5))
    assert value["longitude"] == pytest.approx(np.radians(-130.5))
    assert found.channels["pitch"].interval() == 20.0
    # A pump that does not run, and pressures that are none, are no samples.
    assert len(found.channels["conductivity"]) == 2
    assert "pressure" not in found.channels
    assert "Declination says 16 deg" in texts(found)


def og1(path, **more):
    days = xarray.Variable("N", TIME / 86400.0, {"units": "days since 1970-01-01"})
    data = {
        "TIME": days,
        "PRES": xarray.Variable("N", 1.01 * DEPTH, {"units": "dbar"}),
        "DEPTH": xarray.Variable("N", DEPTH, {"units": "m"}),
        "PITCH": xarray.Variable("N", np.degrees(PITCH), {"units": "degree"}),
        "TEMP": xarray.Variable("N", 10.0 + 0 * TIME, {"units": "degC"}),
        "PSAL": xarray.Variable("N", 35.0 + 0 * TIME, {"units": "1"}),
    }
    xarray.Dataset(data | more).to_netcdf(path)


def test_og1_reads_and_says_that_ballast_is_missing(tmp_path):
    og1(tmp_path / "a.nc")
    found = read_record(tmp_path / "a.nc")
    assert found.kind == "OG-1.0"
    assert found.channels["depth"].interval() == pytest.approx(4.0, rel=1e-3)
    assert found.channels["pitch"].values.max() == pytest.approx(0.4)
    assert "OG-1.0 has no agreed variable" in texts(found)
    assert "ballast" in missing_for(found)["steady"]


def test_og1_with_the_ballast_of_seagliderog1(tmp_path):
    volume = xarray.Variable("N", -200.0 * np.sign(RATE), {"units": "cm3"})
    og1(tmp_path / "a.nc", VBD_CC=volume)
    found = read_record(tmp_path / "a.nc")
    assert found.channels["ballast"].values.max() == pytest.approx(2e-4)


def test_seaglider_dives_have_two_clocks(tmp_path):
    for dive in (1, 2):
        time = TIME[:100] + 1000.0 * dive
        xarray.Dataset(
            {
                "time": ("sg_data_point", time),
                "depth": ("sg_data_point", DEPTH[:100], {"units": "meters"}),
                "eng_pitchAng": ("sg_data_point", np.degrees(PITCH[:100])),
                "eng_vbdCC": ("sg_data_point", 100.0 + 0 * time),
                "eng_pitchCtl": ("sg_data_point", -0.5 + 0 * time),
                "ctd_time": ("ctd", time[::2] + 1.0),
                "ctd_pressure": ("ctd", DEPTH[:100:2] * 1.01, {"units": "dbar"}),
                "temperature": ("ctd", 8.0 + 0 * time[::2]),
                "salinity": ("ctd", 34.0 + 0 * time[::2]),
            }
        ).to_netcdf(tmp_path / f"p{dive}.nc")
    found = read_record(sorted(tmp_path.glob("p*.nc")))
    assert found.kind == "Seaglider"
    assert len(found.channels["pitch"]) == 200
    assert len(found.channels["temperature"]) == 100
    assert found.channels["temperature"].time[0] == 1001.0
    assert found.channels["mass_position"].values[0] == pytest.approx(-0.005)
    assert found.channels["ballast"].values[0] == pytest.approx(1e-4)


def test_density_is_that_of_teos10():
    gsw = pytest.importorskip("gsw")
    flat = np.ones(len(TIME))
    bare = record(
        salinity=35.0 * flat, temperature=10.0 * flat, pressure=1e5 * DEPTH / 10
    )
    channels = {k: v for k, v in bare.channels.items() if k != "density"}
    found = with_density(FlightRecord("a", "a", channels))
    expected = gsw.rho(
        gsw.SR_from_SP(35.0), gsw.CT_from_t(gsw.SR_from_SP(35.0), 10.0, 0.0), 0.0
    )
    assert found.channels["density"].values[0] == pytest.approx(expected, abs=1e-6)
    # Check value of the TEOS-10 manual's order of size: sea water at the surface.
    assert expected == pytest.approx(1026.95, abs=0.05)


def test_table_with_units_in_its_heads(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "# remark\ntime_s,pressure_bar,pitch_deg,speed_m_s\n0,1,30,\n4,2,,1\n"
    )
    found = read_record(path)
    assert found.channels["pressure"].values.tolist() == [1e5, 2e5]
    assert "has fewer than two values" in texts(found)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time_s,depth\n0,1\n", "must end in a unit of depth"),
        ("time_s,deepness_m\n0,1\n", "'deepness_m' is no channel"),
        ("time_s,depth_m\n0,1\n1\n", "every line must have 2 cells"),
        ("time_s,depth_m\n0,x\n", "column depth_m: could not convert"),
        ("depth_m\n1\n", "time_s among them"),
        ("", "time_s among them"),
    ],
)
def test_a_bad_table_is_refused(tmp_path, text, complaint):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        read_record(path)


def test_disorder_duplicates_and_spikes_are_reported_and_dropped():
    time = np.concatenate([TIME, TIME[:5]])
    values = np.concatenate([DEPTH, DEPTH[:5]])
    values[50] += 30.0
    found = clean(FlightRecord("a", "a", {"depth": Series(time, values)}))
    assert len(found.channels["depth"]) == len(TIME) - 1
    assert np.all(np.diff(found.channels["depth"].time) > 0)
    said = texts(found)
    assert "its clock steps back 1 times" in said
    assert "5 times stand twice" in said
    assert "1 spikes were dropped" in said


def test_gaps_are_reported_and_not_compared():
    there = (TIME < 1000.0) | (TIME > 1400.0)
    channels = {
        k: Series(TIME[there], s.values[there]) for k, s in record().channels.items()
    }
    found = clean(FlightRecord("a", "a", channels))
    assert "1 gaps of 408 to 408 s" in texts(found)
    flight = uniform(found)
    inside = (flight.time > 1010.0) & (flight.time < 1390.0)
    assert not flight.good[inside].any()
    assert flight.good[~inside].any()


@pytest.mark.parametrize("name", ["pitch", "ballast"])
def test_a_wrong_sign_is_warned_of(name):
    wrong = clean(record(**{name: -record().channels[name].values}))
    assert any(f"{name}: seems to have the other sign" in w for w in wrong.warnings())
    assert not clean(record()).warnings()


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("pitch", 57.3, "rad"), ("ballast", 1e6, "m\\^3"), ("density", 1e-3, "kg")],
)
def test_a_wrong_unit_is_refused(name, factor, unit):
    wrong = record(**{name: factor * record().channels[name].values})
    with pytest.raises(ValueError, match=f"{name} must be in {unit}"):
        clean(wrong)


@pytest.mark.parametrize(("name", "factor"), [("depth", 0.1), ("ballast", 1e-3)])
def test_a_unit_that_is_a_hundredth_of_what_it_says_is_warned_of(name, factor):
    small = clean(record(**{name: factor * record().channels[name].values}))
    assert any(f"{name}: moves by" in w for w in small.warnings())


def test_nothing_is_refused():
    empty = Series(np.array([]), np.array([]))
    with pytest.raises(ValueError, match="no channel of a flight has two values"):
        clean(FlightRecord("a", "a", {"depth": empty}))


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.npy", b"no array", "no NumPy array"),
        ("a.nc", b"no netcdf", "cannot be read"),
        ("a.doc", b"text", "no reader for this kind"),
        ("x.gli.sub.1", b"a,b\n1,2\n", "its first line must name Timestamp"),
    ],
)
def test_files_of_another_kind_are_refused(tmp_path, name, content, complaint):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=complaint):
        read_record(tmp_path / name)


def test_a_missing_file_and_an_empty_folder_are_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_record(tmp_path / "none.npy")
    with pytest.raises(ValueError, match="no file of a flight in this folder"):
        read_record(tmp_path)


def test_the_depth_rate_of_a_model_is_smoothed_as_the_record_is():
    # The slope of a parabola through the sum of the rates, against numpy's own fit.
    rate = np.random.default_rng(0).normal(size=60)
    depth = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    ours = np.convolve(rate, kernel(6), mode="same")[30]
    around = np.arange(-6, 7)
    assert ours == pytest.approx(np.polyfit(around, depth[24:37], 2)[1], abs=1e-12)
    assert kernel(6).sum() == pytest.approx(1.0)


def test_dives_and_steady_glides_are_found():
    flight = uniform(clean(record()))
    assert flight.dives() == 3
    assert flight.dt == 1.0
    middle = flight.steady & (flight.depth > 10) & (flight.depth < 30)
    down = flight.depth_rate[middle & (flight.pitch < 0)]
    assert down == pytest.approx(40.0 / 600.0, abs=1e-6)
    assert not flight.good[flight.depth < 5.0].any()


def test_record_command_says_what_is_missing(call, tmp_path):
    og1(tmp_path / "a.nc")
    code, out, err = call("record", "a.nc", "--out", "out")
    assert code == 0
    assert "fit --kind steady: not possible, lacks ballast" in out
    assert "speed: not recorded" in out
    assert (tmp_path / "out" / "record.png").stat().st_size > 10_000
    assert (
        json.loads((tmp_path / "out" / "record.json").read_text())["kind"] == "OG-1.0"
    )
    assert "record.json" in err
    code, out, err = call("record", "none.dbd")
    assert code == 2
    assert "no such file" in err
    assert "Traceback" not in err
