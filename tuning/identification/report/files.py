"""Files by which a fit goes on: vehicle, uncertainty, and a mission in its water."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.files.writing import write_text
from jaxglider.vehicle.parameters import GliderParameters, VehicleData
from jaxglider.vehicle.published import key_units, vehicle_text
from tuning.identification.fitting import Fit
from tuning.identification.glider import PLACES, value_of
from tuning.identification.information.least_squares import correlations
from tuning.identification.knowledge import Estimate, estimates
from tuning.identification.report.mission import mission_toml, water_csv


def vehicle_toml(fit: Fit, name: str, source: str, origin: str) -> str:
    """The fitted vehicle as a file: what was fitted is marked so, with its deviation.

    Args:
        fit: the fit.
        name: name of the vehicle.
        source: name of the record and its digest, for each fitted number.
        origin: name or path of the vehicle file that the fit started from; its other
            numbers keep their sources.
    """
    known = {e.name: e for e in estimates(fit)}
    old = _entries(origin)
    lines = [
        f"# {name}: {fit.vehicle.name} fitted to its flight record.",
        f"# {source}.",
        *(f"# {text}" for text in _of_the_record(fit)),
        "",
        f"name = {_quoted(name)}",
    ]
    for table, holder in _tables(fit):
        lines += ["", f"[{table}]"]
        for field in dataclasses.fields(holder):
            key = f"{table}.{field.name}"
            entry = dict(old.get(key, {"source": f"from {origin}"}))
            entry |= {"value": float(getattr(holder, field.name))}
            entry |= {"unit": key_units()[key]}
            if field.name in known and PLACES[field.name] == table:
                entry |= _fitted(known[field.name], source)
            lines.append(f"{field.name} = {_inline(entry)}")
    return "\n".join(lines) + "\n"


def _tables(fit: Fit) -> list[tuple[str, Any]]:
    tables: list[tuple[str, Any]] = [
        ("parameters", fit.after.parameters),
        ("limits", fit.vehicle.limits),
    ]
    if fit.vehicle.body is not None:
        tables.insert(1, ("body", fit.after.body))
    if fit.vehicle.rates is not None:
        tables.append(("rates", fit.vehicle.rates))
    return tables


def _of_the_record(fit: Fit) -> list[str]:
    r = fit.after.record
    return [
        "Not in this file, for a vehicle has no place for them:",
        f"  neutral mass {float(r.mass):.4f} kg for a volume of "
        f"{1e3 * float(fit.after.volume):.3f} L,",
        f"  compressibility {float(r.compressibility):.3g} 1/Pa,",
        f"  true pitch = {float(r.pitch_scale):.4f} x recorded "
        f"{float(r.pitch_offset):+.4f} rad,",
        f"  r_p1 = recorded position - {float(r.position_offset):.4f} m.",
    ]


def _fitted(one: Estimate, source: str) -> dict[str, Any]:
    told = f"95 % within {one.low:.6g} and {one.high:.6g}"
    if not one.identified:
        told = "the record hardly tells it: the prior holds; " + told
    return {
        "source": f"fit: {source}",
        "doubt": told,
        "standard_deviation": one.deviation,
    }


def _entries(origin: str) -> dict[str, dict[str, Any]]:
    """Entries of the vehicle file that the fit started from, by key."""
    try:
        data = tomllib.loads(vehicle_text(origin))
    except (OSError, ValueError):
        return {}
    return {
        f"{table}.{key}": entry
        for table in ("parameters", "body", "limits", "rates")
        for key, entry in data.get(table, {}).items()
        if isinstance(entry, dict)
    }


_ORDER = ("value", "unit", "symbol", "source", "doubt", "standard_deviation")


def _inline(entry: dict[str, Any]) -> str:
    cells = [f"{key} = {_literal(entry[key])}" for key in _ORDER if key in entry]
    return "{ " + ", ".join(cells) + " }"


def _literal(value: Any) -> str:
    return _quoted(value) if isinstance(value, str) else repr(float(value))


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def uncertainty_toml(fit: Fit) -> str | None:
    """The covariance of the fit as the ensemble of `tune` and `sweep`.

    A log-normal factor on each fitted parameter of the equations, with the correlations
    of the fit. Numbers of the record alone are no parameters of a simulation and are
    left out. None where no parameter was fitted.

    Args:
        fit: the fit.
    """
    names = [f.name for f in dataclasses.fields(GliderParameters)]
    chosen = [
        k
        for k, p in enumerate(fit.plan.free)
        if p.name in names and abs(float(value_of(fit.after, p.name))) > 1e-9
    ]
    if not chosen:
        return None
    matrix = correlations(fit.solution.covariance)[np.ix_(chosen, chosen)]
    known = estimates(fit)
    shares = [min(known[k].deviation / abs(known[k].value), 1.0) for k in chosen]
    free = [fit.plan.free[k].name for k in chosen]
    rows = ",\n".join(
        "  [" + ", ".join(f"{float(v):.6f}" for v in row) + "]" for row in matrix
    )
    return (
        "# Uncertainty of a fitted vehicle: the covariance of its fit, as factors on\n"
        "# what vehicle.toml says. For `tune` and `sweep` with --uncertainty FILE.\n\n"
        "[[vehicle]]\n"
        f"names = [{', '.join(_quoted(n) for n in free)}]\n"
        'law = "log-normal"\n'
        f"standard_deviation = [{', '.join(f'{s:.6g}' for s in shares)}]\n"
        "truncation = 3.0\n"
        f"correlation = [\n{rows},\n]\n"
    )


def write_files(
    fit: Fit, folder: Path, name: str, source: str, origin: str
) -> list[str]:
    """Write the vehicle, its uncertainty where there is one, its water and a mission.

    Args:
        fit: the fit.
        folder: folder to write to.
        name: name of the vehicle.
        source: name of the record and its digest.
        origin: name or path of the vehicle file that the fit started from.

    Returns:
        Names of the files.
    """
    texts = {
        "vehicle.toml": vehicle_toml(fit, name, source, origin),
        "uncertainty.toml": uncertainty_toml(fit),
        "water.csv": water_csv(fit.flight),
        "mission.toml": mission_toml(fit, name),
    }
    written = []
    for file, text in texts.items():
        if text is not None:
            write_text(folder / file, text)
            written.append(file)
    return written


def vehicle_of_fit(fit: Fit, name: str) -> VehicleData:
    """The fitted vehicle, as its file would be read.

    Args:
        fit: the fit.
        name: name of the vehicle.
    """
    deviations = {
        f"{PLACES[e.name]}.{e.name}": e.deviation
        for e in estimates(fit)
        if PLACES[e.name] != "record"
    }
    return dataclasses.replace(
        fit.vehicle,
        name=name,
        parameters=fit.after.parameters,
        body=fit.vehicle.body if fit.vehicle.body is None else fit.after.body,
        deviations={**fit.vehicle.deviations, **deviations},
    )
