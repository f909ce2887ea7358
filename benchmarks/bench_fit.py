"""Fits of two real flights, held out, against what they are expected to give.

    python benchmarks/bench_fit.py FOLDER [--only NAME ...]

FOLDER holds `slocum-comet-2016` (`gliderflight_data.npy`, and `raw` with the binary
files) and `seaexplorer-sea035`, as they come with the packages gliderflight (MIT) and
pyglider (Apache-2.0). Exit code 3 where a figure is outside its range.
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from jaxglider.vehicle.published import load_vehicle
from tuning import fit
from tuning.identification.record.reading import read_record

VOLUME = 70.0 / 1004.0
"""Volume [m³] that the published calibration of the Slocum has."""


def rms(result, name, low=0.0, high=1e9):
    """Error on held-out dives between two depths [m], in cm/s or deg."""
    flight = result.fit.flight
    at = np.isin(flight.dive, result.fit.plan.held_out) & flight.good
    at &= (flight.depth > low) & (flight.depth < high)
    error = result.verdict.after[name] - result.verdict.measured[name]
    error = error[at & np.isfinite(error)]
    factor = 100.0 if name in ("depth_rate", "speed") else 180.0 / np.pi
    return factor * np.sqrt(np.mean(error**2)), factor * np.mean(error)


def published(folder):
    return read_record(folder / "slocum-comet-2016" / "gliderflight_data.npy")


def comet_depth_rate(folder):
    """The published table, its pitch already corrected; depth rate alone."""
    found = fit(published(folder), speed=False, volume=VOLUME)
    speed, bias = rms(found, "speed")
    return [
        ("drag [kg/m]", found["drag"].value, 7.70, 8.00),
        ("neutral mass [kg]", found["mass"].value, 70.098, 70.106),
        ("depth rate, 10 to 35 m [cm/s]", rms(found, "depth_rate", 10, 35)[0], 0, 0.42),
        ("depth rate, turns too [cm/s]", rms(found, "depth_rate", 5)[0], 0, 0.81),
        ("speed [cm/s]", speed, 0, 1.15),
        ("speed, bias [cm/s]", bias, -0.4, 0.4),
        (
            "warned of speed",
            float("SPEED IS UNTESTED" in " ".join(found.remarks)),
            1,
            1,
        ),
    ]


def comet_raw_pitch(folder):
    """The pitch as its sensor gave it; the speed not used, then used."""
    record = published(folder)
    pitch = record.channels["pitch"]
    raw = dataclasses.replace(pitch, values=(pitch.values + 0.004) / 0.86)
    record = dataclasses.replace(record, channels={**record.channels, "pitch": raw})
    alone = fit(record, kind="steady", speed=False, volume=VOLUME)
    used = fit(record, volume=VOLUME)
    warned = "SPEED IS UNTESTED" in " ".join(alone.remarks)
    return [
        ("speed unused: bias [cm/s]", rms(alone, "speed")[1], -5.1, -4.1),
        ("speed unused: warned", float(warned), 1, 1),
        ("tilt of the pitch sensor", used["pitch_scale"].value, 0.85, 0.91),
        ("speed used: its error [cm/s]", rms(used, "speed")[0], 0, 1.15),
        ("speed used: bias [cm/s]", rms(used, "speed")[1], -0.4, 0.4),
    ]


def comet_closed(folder):
    """Pitch, depth rate and speed from the actuators alone."""
    place = folder / "slocum-comet-2016"
    record = read_record([place / "raw", place / "gliderflight_data.npy"])
    found = fit(record, kind="closed", volume=VOLUME)
    return [
        ("pitch, turns too [deg]", rms(found, "pitch")[0], 0, 0.75),
        ("depth rate, 10 to 35 m [cm/s]", rms(found, "depth_rate", 10, 35)[0], 0, 0.45),
        ("speed [cm/s]", rms(found, "speed")[0], 0, 1.3),
        ("heading refused", float("HEADING IS NOT" in " ".join(found.remarks)), 1, 1),
    ]


def sea035(folder):
    """A SeaExplorer to 700 m: odd dives to even dives, depth rate alone."""
    record = read_record(folder / "seaexplorer-sea035")
    vehicle = load_vehicle("seawing")
    found = fit(record, vehicle, kind="steady", held_out="alternate", mass=59.0)
    steady = found.verdict.scores["depth_rate"]["held_out_steady"]
    return [
        ("depth rate, steady [cm/s]", 100 * steady.rms, 0, 0.8),
        ("compressibility [1e-10/Pa]", 1e10 * found["compressibility"].value, 2.9, 3.5),
    ]


CASES = {
    "comet-depth-rate": comet_depth_rate,
    "comet-raw-pitch": comet_raw_pitch,
    "comet-closed": comet_closed,
    "sea035": sea035,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    failed = 0
    for name in options.only:
        begun, used = time.monotonic(), time.process_time()
        rows = CASES[name](options.folder)
        wall, cpu = time.monotonic() - begun, time.process_time() - used
        print(f"{name}: {wall:.1f} s wall, {cpu:.1f} s processor, compiling included")
        for label, value, low, high in rows:
            inside = low <= value <= high
            failed += not inside
            mark = "" if inside else "   OUTSIDE"
            print(
                f"  {label:<34}{value:>10.4g}   {low:g} to {high:g}{mark}", flush=True
            )
    return 3 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
