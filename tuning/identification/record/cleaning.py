"""Cleaning of a record: order, duplicates, impossible values, spikes, gaps, signs.

Nothing is changed silently: every step leaves a finding. Values are dropped, never
replaced by a guess. Units and signs are checked and complained of, never converted.
"""

import dataclasses

import numpy as np

from tuning.identification.record.flight_record import (
    CHANNELS,
    RANGES,
    Finding,
    FlightRecord,
    Series,
)

GAP = 60.0
"""Shortest time [s] without a sample that counts as a gap, if also ten intervals."""
SPIKE = 8.0
"""Distance of a spike from the median of its neighbours, in their own spreads."""
_SOMETIMES = ("speed", "latitude", "longitude", "wanted_heading")
_SMOOTH = (
    "pressure",
    "depth",
    "density",
    "temperature",
    "salinity",
    "conductivity",
    "speed",
)


def clean(record: FlightRecord) -> FlightRecord:
    """A record in order of time, without what cannot be, and with what was found.

    Args:
        record: record as its reader made it.

    Raises:
        ValueError: a channel is in a unit that it cannot be in, or nothing is left.
    """
    findings: list[Finding] = []
    channels = {}
    for name, series in record.channels.items():
        kept = _ordered(name, series, findings)
        kept = _in_range(record.name, name, kept, findings)
        if name in _SMOOTH:
            kept = _without_spikes(name, kept, findings)
        if len(kept) < 2:
            findings.append(Finding(name, "has fewer than two values; left out."))
            continue
        channels[name] = kept
    if not channels:
        raise ValueError(
            f"{record.name}: no channel of a flight has two values; received "
            f"{', '.join(record.channels) or 'none'}. Give the files of a flight."
        )
    findings += _gaps(channels)
    cleaned = dataclasses.replace(record, channels=channels).with_findings(findings)
    return cleaned.with_findings([*sign_findings(cleaned), *_small(cleaned)])


def _ordered(name: str, series: Series, findings: list[Finding]) -> Series:
    """Finite samples in order of time, one for each time."""
    good = np.isfinite(series.time) & np.isfinite(series.values)
    time, values = series.time[good], series.values[good]
    back = int((np.diff(time) < 0.0).sum())
    if back:
        findings.append(
            Finding(
                name,
                f"its clock steps back {back} times; put in order of time.",
                warning=back > 0.01 * len(time),
            )
        )
        order = np.argsort(time, kind="stable")
        time, values = time[order], values[order]
    first = np.concatenate([[True], np.diff(time) > 0.0]) if len(time) else time > 0
    if (again := int((~first).sum())) > 0:
        findings.append(Finding(name, f"{again} times stand twice; the first counts."))
    return Series(time[first], values[first])


def _in_range(
    record: str, name: str, series: Series, findings: list[Finding]
) -> Series:
    """Without values that the channel cannot have.

    Raises:
        ValueError: so many are out of range that the unit must be another one.
    """
    low, high = RANGES[name]
    good = (series.values >= low) & (series.values <= high)
    bad = int((~good).sum())
    if not bad:
        return series
    if bad > 0.2 * len(series):
        middle = float(np.median(series.values))
        raise ValueError(
            f"{record}: {name} must be in {CHANNELS[name][0]}, from {low:g} to "
            f"{high:g}; {bad} of {len(series)} values are not, their median is "
            f"{middle:g}. Convert its unit (degrees, inches, bar, cm^3?) and try again."
        )
    findings.append(
        Finding(name, f"{bad} of {len(series)} values are out of range; dropped.")
    )
    return Series(series.time[good], series.values[good])


def _without_spikes(name: str, series: Series, findings: list[Finding]) -> Series:
    """Without values far from the median of the five around them."""
    if len(series) < 9:
        return series
    windows = np.lib.stride_tricks.sliding_window_view(series.values, 5)
    middle = series.values.copy()
    middle[2:-2] = np.median(windows, axis=1)
    off = np.abs(series.values - middle)
    spread = 1.4826 * np.median(off) + 1e-9 + 1e-3 * np.ptp(series.values)
    spikes = off > SPIKE * spread
    if not spikes.any():
        return series
    findings.append(Finding(name, f"{int(spikes.sum())} spikes were dropped."))
    return Series(series.time[~spikes], series.values[~spikes])


def _gaps(channels: dict[str, Series]) -> list[Finding]:
    """One finding for all channels that have the same gaps."""
    same: dict[tuple[int, int, int, bool], list[str]] = {}
    for name, series in channels.items():
        steps = np.diff(series.time)
        long = steps[steps > max(GAP, 10.0 * series.interval())]
        if len(long) and name not in _SOMETIMES:
            much = bool(long.sum() > 0.2 * np.ptp(series.time))
            key = (len(long), round(long.min()), round(long.max()), much)
            same.setdefault(key, []).append(name)
    return [
        Finding(
            ", ".join(names),
            f"{count} gaps of {low} to {high} s; a fit leaves out what lies in them.",
            warning=much,
        )
        for (count, low, high, much), names in same.items()
    ]


_LEAST = {
    "pressure": (5e4, "5 dbar"),
    "depth": (5.0, "5 m"),
    "ballast": (2e-5, "20 cc"),
}
"""Smallest range that a channel of a flight has, in its unit and in words."""


def _small(record: FlightRecord) -> list[Finding]:
    """Warnings where a channel moves so little that its unit must be another one."""
    found = []
    for name, (least, words) in _LEAST.items():
        if not record.has(name):
            continue
        span = float(np.ptp(record.channels[name].values))
        if span < least:
            found.append(
                Finding(
                    name,
                    f"moves by {span:.3g} {CHANNELS[name][0]} in all, less than the "
                    f"{words} of any dive: is its unit another one?",
                    warning=True,
                )
            )
    return found


def sign_findings(record: FlightRecord) -> list[Finding]:
    """Warnings where pitch, ballast or moving mass seem to have the other sign.

    A glider sinks nose down, with little ballast volume and its mass forward.

    Args:
        record: record with depth or pressure.
    """
    source = "pressure" if record.has("pressure") else "depth"
    if not record.has(source):
        return []
    depth = record.channels[source]
    rate = np.gradient(depth.values, depth.time) if len(depth) > 3 else depth.values
    findings = []
    for name, sense, rule in (
        ("pitch", -1.0, "nose up is positive"),
        ("ballast", -1.0, "more volume, which rises, is positive"),
        ("mass_position", 1.0, "forward is positive"),
    ):
        if not record.has(name):
            continue
        series = record.channels[name]
        there = (depth.time >= series.time[0]) & (depth.time <= series.time[-1])
        if there.sum() < 30:
            continue
        values = np.interp(depth.time[there], series.time, series.values)
        if np.ptp(values) < 1e-9 or np.ptp(rate[there]) < 1e-9:
            continue
        agreement = sense * float(np.corrcoef(values, rate[there])[0, 1])
        if agreement < -0.3:
            findings.append(
                Finding(
                    name,
                    f"seems to have the other sign (correlation {agreement:.2f} with "
                    f"what the depth does): {rule}. If so, give --flip {name}.",
                    warning=True,
                )
            )
    return findings


def flipped(record: FlightRecord, names: tuple[str, ...]) -> FlightRecord:
    """The record with the sign of some channels turned, as its user says.

    Args:
        record: record as read.
        names: names of channels.

    Raises:
        ValueError: the record has no such channel.
    """
    channels = dict(record.channels)
    for name in names:
        if name not in channels:
            raise ValueError(
                f"flip must name a channel of the record, among "
                f"{', '.join(channels)}; received {name!r}."
            )
        channels[name] = Series(channels[name].time, -channels[name].values)
    told = [Finding(name, "its sign was turned, as told.") for name in names]
    kept = [
        f
        for f in record.findings
        if not ("other sign" in f.text and f.channel in names)
    ]
    return dataclasses.replace(record, channels=channels, findings=(*kept, *told))
