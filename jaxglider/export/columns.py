"""Facts about an export that test programs need: the columns of their files."""

from collections.abc import Mapping, Sequence

from jaxglider.export.autopilot import Source
from jaxglider.export.c.fields import Field
from jaxglider.export.c.source import Structure
from jaxglider.export.sensing import ANTENNA

FLOAT_ALLOWANCES = {"COMMAND_FLOAT": 5e-2, "STATE_FLOAT": 2e-2}
"""Largest relative difference in single precision; see the text of `parity.c`."""


def columns_text(
    source: Source, plant: Source, about: str, rows: Mapping[str, int]
) -> str:
    """The text of columns.h.

    Args:
        source: the autopilot.
        plant: the simulated glider.
        about: a line for the head of the file.
        rows: number of comparable rows of each file, by name.
    """
    structures = source.structures
    counts = {
        name.upper(): _count(structures[name])
        for name in ("measurement", "reference", "command")
    }
    counts["ROW"] = sum(counts.values())
    counts["STATE"] = 12
    counts["FORCE"] = 6
    counts["CLOSED"] = 18
    lines = [f"#define {name}_COLUMNS {count}" for name, count in counts.items()]
    lines += [f"#define {name} {value!r}" for name, value in FLOAT_ALLOWANCES.items()]
    lines += [f"#define {name}_ROWS {count}" for name, count in rows.items()]
    defines = "\n".join(lines)
    return f"""/* {about} */
#ifndef COLUMNS_H
#define COLUMNS_H

#include "glider.h"

{defines}

{_reader("read_measurement", structures["measurement"], "glider_measurement")}
{_writer("write_reference", structures["reference"], "glider_reference")}
{_writer("write_command", structures["command"], "glider_command")}
{_limits(structures["parameters"].fields())}
{_spoiler(structures["reference"])}
{_believable(structures["measurement"].fields())}
#ifdef PLANT_H
{_reader("read_force", plant.structures["force"], "plant_force")}
{_plant(plant.structures["state"].fields(), structures["measurement"].fields())}
#endif
#endif
"""


def _count(structure: Structure) -> int:
    return sum(f.size for f in structure.fields())


def _body(signature: str, lines: Sequence[str]) -> str:
    inside = "\n".join(f"    {line}" for line in lines)
    return f"static inline void {signature}\n{{\n{inside}\n}}\n"


def _reader(name: str, structure: Structure, kind: str) -> str:
    casts = {"real": "(glider_real)", "int32": "(int32_t)", "bool": "0.0 != "}
    lines, at = [], 0
    for field in structure.fields():
        for place in field.places("to->"):
            cast = "" if field.origin else casts[field.kind]
            lines.append(f"{place} = {cast}row[{at}];")
            at += 1
    return _body(f"{name}(const double *row, {kind} *to)", lines)


def _writer(name: str, structure: Structure, kind: str) -> str:
    places = [p for field in structure.fields() for p in field.places("from->")]
    lines = [f"row[{n}] = (double){place};" for n, place in enumerate(places)]
    lines = lines or ["(void)from;", "(void)row;"]
    return _body(f"{name}(const {kind} *from, double *row)", lines)


def _limits(parameters: Sequence[Field]) -> str:
    names = [
        f.name
        for f in parameters
        if f.name.removeprefix("pilot_").startswith("actuators_")
        and f.name.endswith("_limit")
        and "_rate_" not in f.name
    ]
    lines = [f"row[{n}] = (double)glider_gains.{name};" for n, name in enumerate(names)]
    return _body("write_limits(double *row)", [*lines, "row[3] = 1.0;"])


def _spoiler(structure: Structure) -> str:
    reals = [f for f in structure.fields() if f.kind == "real" and not f.shape]
    lines = [f"to->{reals[-1].name} = value;"] if reals else ["(void)to; (void)value;"]
    return _body(
        "spoil_reference(glider_reference *to, const glider_real value)", lines
    )


def _believable(measurement: Sequence[Field]) -> str:
    """A row of small numbers made one that sensors could have given."""
    lines = []
    for at, field in enumerate(measurement):
        if field.origin:
            lines.append(f"row[{at}] += {field.origin};")
        elif field.name.endswith("_time"):
            lines.append(f"row[{at}] = row[0];")
        elif field.kind == "bool":
            lines.append(f"row[{at}] = 1.0;")
    return _body("make_believable(double *row)", lines or ["(void)row;"])


def _plant(state: Sequence[Field], measurement: Sequence[Field]) -> str:
    names = [f.name for f in state[:12]]
    commands = ("buoyancy_mass", "mass_position", "mass_angle")
    measure = ["to->time = (glider_real)time;"]
    measure += [_measured(field) for field in measurement[1:]]
    write = [f"row[{k}] = (double)from->{n};" for k, n in enumerate(names)]
    steer = [f"to->{n} = from->{n};" for n in commands]
    return (
        _body(
            "measure(const plant_state *from, const double time, "
            "glider_measurement *to)",
            measure,
        )
        + _body("write_state(const plant_state *from, double *row)", write)
        + _body("steer(const glider_command *from, plant_command *to)", steer)
    )


def _measured(field: Field) -> str:
    """A field of the measurement, from a glider whose sensors have no errors."""
    name, to = field.name, f"to->{field.name}"
    if name.startswith("echo"):
        return f"{to} = {'false' if field.kind == 'bool' else 'REAL(0.0)'};"
    if name == "fix_valid":
        return f"{to} = from->depth < REAL({ANTENNA!r});"
    if field.kind == "bool":
        return f"{to} = true;"
    if name.endswith("_time"):
        return f"{to} = (glider_real)time;"
    if name.startswith("position_"):
        return f"{to} = from->held_{name.removeprefix('position_')};"
    own = name.removeprefix("fix_")
    if field.origin:
        return f"{to} = (double)from->{own} + {field.origin};"
    return f"{to} = from->{own};"
