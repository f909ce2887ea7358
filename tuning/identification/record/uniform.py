"""A record on one clock, cut into dives: what every fit works with.

The depth rate is the slope of a local parabola through the depth.
"""

import dataclasses

import numpy as np

from tuning.identification.record.flight_record import FlightRecord
from tuning.identification.record.seawater import GRAVITY, mean_density
from tuning.identification.record.slopes import slope

SMOOTHING = 30.0
"""Length of the parabola [s]; five samples of the depth where these take longer."""
SURFACE = 2.0
"""Depth [m] above which a glider floats or is thrown about."""
SHALLOW = 5.0
"""Depth [m] above which nothing is compared."""
AWAY = 40.0
"""Time after the surface [s] in which the speed is still unknown."""
SETTLED = 90.0
"""Time after a change of ballast [s] from which a glide is steady."""


@dataclasses.dataclass(frozen=True)
class Flight:
    """A record on one clock; arrays of one length, NaN where nothing was measured.

    Attributes:
        time: times [s] from the first on, evenly spaced.
        dt: time step [s].
        half_width: steps on either side of the parabola that gives the depth rate.
        depth: depth [m].
        pressure: pressure [Pa].
        pitch: pitch as recorded [rad].
        density: density of the water [kg/m³].
        temperature: temperature [°C].
        ballast: volume of the ballast [m³].
        depth_rate: depth rate [m/s], smoothed.
        speed: speed through the water [m/s].
        roll: roll as recorded [rad].
        heading: heading [rad], not wrapped.
        mass_position: position of the moving mass [m].
        mass_angle: roll angle of the moving mass [rad].
        dive: number of the dive, from 1; 0 before the first.
        good: flags of the samples at which a model may be compared.
        steady: flags of those in a steady glide.
        afloat: flags of the samples at the surface.
        notes: sentences about what was left out.
    """

    time: np.ndarray
    dt: float
    half_width: int
    depth: np.ndarray
    pressure: np.ndarray
    pitch: np.ndarray
    density: np.ndarray
    temperature: np.ndarray
    ballast: np.ndarray
    depth_rate: np.ndarray
    speed: np.ndarray
    roll: np.ndarray
    heading: np.ndarray
    mass_position: np.ndarray
    mass_angle: np.ndarray
    dive: np.ndarray
    good: np.ndarray
    steady: np.ndarray
    afloat: np.ndarray
    notes: tuple[str, ...] = ()

    def dives(self) -> int:
        """Number of dives."""
        return int(self.dive.max(initial=0))

    def has(self, name: str) -> bool:
        """Whether a channel was measured at all."""
        return bool(np.isfinite(getattr(self, name)).any())


NEEDED = ("pitch", "ballast", "density")
"""Channels, beside depth or pressure, that no fit can do without."""


def missing_for(record: FlightRecord) -> dict[str, list[str]]:
    """Channels that each fit lacks, by its name; an empty list where it can be made.

    Args:
        record: cleaned record.
    """
    base = [name for name in NEEDED if not record.has(name)]
    if not (record.has("depth") or record.has("pressure")):
        base.insert(0, "depth or pressure")
    closed = [] if record.has("mass_position") else ["mass_position"]
    return {"steady": base, "driven": base, "closed": [*base, *closed]}


def uniform(record: FlightRecord, dt: float | None = None) -> Flight:
    """Put a record on one clock.

    Values in between are linear; where the nearest samples of a channel that is needed
    are far apart, nothing is compared.

    Args:
        record: cleaned record.
        dt: time step [s]; by default one second, or a quarter of the interval of the
            depth where that is longer.

    Raises:
        ValueError: a channel is missing, or there are no two dives.
    """
    lacking = missing_for(record)["steady"]
    if lacking:
        raise ValueError(
            f"{record.name}: a fit needs {', '.join(lacking)}, which the record lacks; "
            f"it has {', '.join(record.channels)}. Give more files of the flight "
            "(`jaxglider record` says what each has)."
        )
    source = "pressure" if record.has("pressure") else "depth"
    interval = record.channels[source].interval()
    step = dt or max(1.0, interval / 4.0)
    begin = max(record.channels[n].time[0] for n in (source, *NEEDED))
    end = min(record.channels[n].time[-1] for n in (source, *NEEDED))
    if end - begin < 600.0:
        raise ValueError(
            f"{record.name}: {source}, {', '.join(NEEDED)} must overlap for ten "
            f"minutes at least; they do for {max(end - begin, 0.0):.0f} s."
        )
    clock = np.arange(begin, end, step)
    good = np.ones(len(clock), dtype=bool)
    values = {
        name: _on(record, name, clock, good, needed=name in (source, *NEEDED))
        for name in _FIELDS
    }
    heavy = GRAVITY * mean_density(record)
    if source == "pressure":
        values["depth"] = values["pressure"] / heavy
    else:
        values["pressure"] = values["depth"] * heavy
    half = max(round(max(SMOOTHING, 5.0 * interval) / step / 2.0), 2)
    rate = slope(values["depth"], half, step)
    good[:half] = good[-half:] = False
    return _marked(clock - begin, step, half, values, rate, good, record.name)


_FIELDS = (
    "depth",
    "pressure",
    "pitch",
    "density",
    "temperature",
    "ballast",
    "speed",
    "roll",
    "heading",
    "mass_position",
    "mass_angle",
)


def _on(
    record: FlightRecord, name: str, clock: np.ndarray, good: np.ndarray, needed: bool
) -> np.ndarray:
    """A channel at the times of the clock; `good` is taken back where it has gaps."""
    if not record.has(name):
        return np.full(len(clock), np.nan)
    series = record.channels[name]
    values = np.unwrap(series.values) if name == "heading" else series.values
    result = np.interp(clock, series.time, values)
    after = np.clip(np.searchsorted(series.time, clock), 1, len(series) - 1)
    apart = series.time[after] - series.time[after - 1]
    far = apart > max(30.0, 4.0 * series.interval())
    outside = (clock < series.time[0]) | (clock > series.time[-1])
    if name == "speed":
        nearest = np.minimum(
            np.abs(clock - series.time[after]), np.abs(clock - series.time[after - 1])
        )
        return np.where(nearest <= 0.6 * max(1.0, series.interval()), result, np.nan)
    if needed:
        good &= ~(far | outside)
        return result
    return np.where(outside, np.nan, result)


def _marked(
    time: np.ndarray,
    dt: float,
    half: int,
    values: dict[str, np.ndarray],
    rate: np.ndarray,
    good: np.ndarray,
    name: str,
) -> Flight:
    """The flight with its dives and with what of it can be compared."""
    depth = values["depth"]
    reach = max(5.0, 0.3 * float(np.percentile(depth, 98)))
    dive = _dives(depth, reach)
    if dive.max(initial=0) < 2:
        raise ValueError(
            f"{name}: a fit needs two dives at least, one to fit and one to be judged "
            f"on; the depth shows {dive.max(initial=0)}. Give more files of the flight."
        )
    afloat = depth < SURFACE
    flown = since(afloat, dt) > AWAY
    pumping = np.abs(np.gradient(values["ballast"], dt)) > 5e-7
    turning = ~((since(pumping, dt) > SETTLED) & (_until(pumping, dt) > half * dt))
    compared = good & (depth > SHALLOW) & flown & (dive > 0)
    values["speed"], notes = _plausible_speed(values["speed"], dive)
    return Flight(
        notes=notes,
        time=time,
        dt=dt,
        half_width=half,
        depth_rate=rate,
        dive=dive,
        good=compared,
        steady=compared & ~turning,
        afloat=afloat,
        **values,
    )


def _plausible_speed(
    speed: np.ndarray, dive: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Speed without the dives in which it is far from that of all others.

    Far is 20 % of the median of all dives, and six times their own spread.
    """
    numbers = np.unique(dive[np.isfinite(speed)])
    middles = np.array([np.nanmedian(speed[dive == n]) for n in numbers])
    if len(numbers) < 4:
        return speed, ()
    middle = np.median(middles)
    off = np.abs(middles - middle)
    bad = numbers[off > max(0.2 * middle, 6.0 * 1.4826 * float(np.median(off)))]
    notes = tuple(
        f"speed: that of dive {n} ({np.nanmedian(speed[dive == n]):.2f} m/s) is far "
        f"from that of all others ({middle:.2f} m/s); left out."
        for n in bad
    )
    return np.where(np.isin(dive, bad), np.nan, speed), notes


def _dives(depth: np.ndarray, reach: float) -> np.ndarray:
    """Numbers of the dives: one begins at the highest point before each bottom."""
    from scipy.signal import find_peaks

    bottoms, _ = find_peaks(
        np.concatenate([[0.0], depth, [0.0]]), height=reach, prominence=reach
    )
    starts = []
    before = 0
    for bottom in bottoms - 1:
        stretch = depth[before : bottom + 1]
        if len(stretch):
            lowest = stretch.min()
            starts.append(before + int(np.flatnonzero(stretch <= lowest + 0.5)[-1]))
        before = int(bottom)
    return np.searchsorted(np.array(starts), np.arange(len(depth)), side="right")


def since(flags: np.ndarray, dt: float) -> np.ndarray:
    """Time [s] since a flag was last set; infinite before the first.

    Args:
        flags: flags of samples.
        dt: time step [s].
    """
    number = np.arange(len(flags), dtype=float)
    last = np.maximum.accumulate(np.where(flags, number, -np.inf))
    return dt * (number - last)


def _until(flags: np.ndarray, dt: float) -> np.ndarray:
    """Time [s] until a flag is next set; infinite after the last."""
    return since(flags[::-1], dt)[::-1]
