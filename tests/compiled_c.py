"""The exported C code as Python functions, through gcc and ctypes."""

import ctypes
import shutil
import subprocess

import jax
import numpy as np

from jaxglider.export.autopilot import STRICT, TEMPLATES

COMPILER = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")


def compile_library(folder, sources, *flags):
    """A shared library from texts of files; warnings are errors."""
    folder.mkdir(parents=True, exist_ok=True)
    given = {**sources, "glider_real.h": (TEMPLATES / "glider_real.h").read_text()}
    for name, text in given.items():
        (folder / name).write_text(text)
    command = [COMPILER, *STRICT.split(), "-O2", "-fPIC", "-shared", *flags]
    command += [name for name in given if name.endswith(".c")] + [
        "-o",
        "code.so",
        "-lm",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(folder / "code.so"))


def structure(made, single=False):
    """The ctypes twin of a structure of the exported code."""
    kinds = {
        "real": ctypes.c_float if single else ctypes.c_double,
        "bool": ctypes.c_bool,
        "int32": ctypes.c_int32,
    }
    fields = [
        (f.name, kind * f.size if f.shape else kind)
        for f in made.fields()
        for kind in [ctypes.c_double if f.origin else kinds[f.kind]]
    ]
    return type(made.name, (ctypes.Structure,), {"_fields_": fields})


REPLAY = """
#include "glider.h"

void replay(int ticks, const glider_measurement *given, glider_command *command)
{
    glider_state state;
    glider_reference reference;
    glider_init(&state);
    for (int n = 0; n < ticks; n++) {
        glider_plan(&state, &given[n], &reference);
        glider_step(&state, &given[n], &reference, &command[n]);
    }
}
"""
"""The loop over the ticks, in C: a call through ctypes for each would be slower."""


class Onboard:
    """The compiled autopilot."""

    def __init__(self, folder, source, *flags):
        texts = {"glider.h": source.header, "glider.c": source.source}
        self.code = compile_library(folder, {**texts, "replay.c": REPLAY}, *flags)
        single = "-DGLIDER_FLOAT" in flags
        self.types = {k: structure(s, single) for k, s in source.structures.items()}

    def replay(self, times, measured):
        """Commands and status words for a series of measurements."""
        given, command = (
            np.zeros(len(times), np.dtype(self.types[name]))
            for name in ("measurement", "command")
        )
        filled = (times, *jax.tree.leaves(measured))
        for name, column in zip(given.dtype.names, filled, strict=True):
            given[name] = column
        places = (x.ctypes.data_as(ctypes.c_void_p) for x in (given, command))
        self.code.replay(len(times), *places)
        return np.stack([command[name] for name in command.dtype.names], axis=1)


def numbers(made):
    """The fields of a ctypes structure, flat."""
    values = []
    for name, _ in made._fields_:
        value = getattr(made, name)
        values += list(value) if isinstance(value, ctypes.Array) else [value]
    return [float(v) for v in values]


def columns(seen):
    """Commands and status words of a run in JAX, one row a tick."""
    rows = [*jax.tree.leaves(seen.command), seen.status]
    return np.stack([np.asarray(x, float) for x in rows], axis=1)
