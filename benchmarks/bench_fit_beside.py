"""A fit beside the field's tool: `python benchmarks/bench_fit_beside.py FILE`.

FILE is `gliderflight_data.npy`, which comes with the package gliderflight (MIT); that
has to be installed as well (`pip install gliderflight`). Both take drag and neutral
mass of the Slocum "comet" from the depth rate of its first nine dives, by a model of
its motion, and are judged on the nine that follow, by the same measured depth rate, in
steady glides and with all turns below 5 m. Prints errors, and seconds: of jaxglider in
a first call, which compiles, and in a second.
"""

import argparse
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from tuning import fit
from tuning.identification.record.reading import read_record

VOLUME = 70.0 / 1004.0
"""Volume [m³] that the published calibration has."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    options = parser.parse_args()
    record = read_record(options.file)
    ours, first = timed(lambda: fit(record, speed=False, volume=VOLUME))
    _, second = timed(lambda: fit(record, speed=False, volume=VOLUME))
    flight, verdict = ours.fit.flight, ours.verdict
    judged = np.isin(flight.dive, ours.fit.plan.held_out) & flight.good
    measured = verdict.measured["depth_rate"]
    last = flight.time[~np.isin(flight.dive, ours.fit.plan.held_out)].max()
    # It forks, which JAX's threads do not survive: a process of its own.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        table = np.load(options.file)
        theirs, seconds = pool.submit(peer, table, last, flight.time).result()
    rows = (
        ("jaxglider", verdict.after["depth_rate"], f"{first:.1f}, again {second:.1f}"),
        ("gliderflight", theirs, f"{seconds:.1f}"),
    )
    print("| | steady [cm/s] | with turns [cm/s] | wall time [s] |")
    print("|---|---:|---:|---:|")
    for name, rate, took in rows:
        errors = [
            100.0 * np.sqrt(np.nanmean((rate - measured)[judged & part] ** 2))
            for part in (
                (flight.depth > 10.0) & (flight.depth < 35.0),
                flight.depth > 5.0,
            )
        ]
        print(f"| {name} | {errors[0]:.2f} | {errors[1]:.2f} | {took} |")
    print(
        f"{seconds / first:.0f} times as fast compiling, {seconds / second:.0f} after"
    )
    return 0


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """What a function gives, and how long it took [s]."""
    begun = time.perf_counter()
    return function(), time.perf_counter() - begun


def peer(table: np.ndarray, last: float, times: np.ndarray) -> tuple[np.ndarray, float]:
    """Depth rate of gliderflight's dynamic model [m/s], and time of calibrating it [s].

    Args:
        table: time [s], pressure [bar], pitch [rad], ballast [cc] and density [kg/m³].
        last: time until which it is calibrated, from the first on [s].
        times: times of the depth rates [s].
    """
    from gliderflight import DynamicCalibrate  # an optional peer

    since = table[0] - table[0, 0]
    model = DynamicCalibrate(rho0=1004.0)
    model.define(mg=70.0, Vg=VOLUME, Cd0=0.15, ah=3.8, epsilon=6e-10)
    known = since <= last
    part = [row[known] for row in table[:5]]
    model.set_input_data(*part)
    model.OR(10.0 * part[1] < 5.0)
    _, seconds = timed(lambda: model.calibrate("mg", "Cd0"))
    names = ("time", "pressure", "pitch", "buoyancy_change", "density")
    flown = model.solve(dict(zip(names, table[:5], strict=True)))
    rising = flown.U * np.sin(table[2] + flown.alpha)
    return -np.interp(times, since, rising), seconds


if __name__ == "__main__":
    sys.exit(main())
