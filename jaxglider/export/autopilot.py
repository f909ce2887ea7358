"""The autopilot and its plant as files of C."""

import dataclasses
from importlib import resources
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.export.c.block import ExportError
from jaxglider.export.c.outlined import Functions
from jaxglider.export.c.source import (
    Argument,
    Structure,
    Written,
    constants_text,
    helper_text,
    write_function,
)
from jaxglider.onboard.guard import BITS, STATUS
from jaxglider.onboard.of_loop import Pilot
from jaxglider.onboard.sensed import SensedAutopilot
from jaxglider.signals import Command, zeros

TEMPLATES = resources.files("jaxglider.export") / "templates"
CONSTANTS = {"glider": "glider_gains", "plant": "plant_truth"}
"""Name of the constants of each part."""

ORIGINS = {
    f"{owner}{axis}": f"GLIDER_ORIGIN_{axis.upper()}"
    for owner in ("", "fix_")
    for axis in ("north", "east")
}
"""Measured positions are true ones, in double precision; what is taken off them."""

STRICT = "-std=c99 -pedantic -Wall -Wextra -Werror"


class MeasurementInput(eqx.Module):
    """The measurement as the exported code takes it; NaN where a number is missing.

    Attributes:
        time: reading of the clock [s], zero at the start of the mission.
    """

    time: Scalar
    told: Any


class CommandOutput(eqx.Module):
    """The command as the exported code gives it.

    Attributes:
        status: bits of GLIDER_..., zero if nothing is to be said.
    """

    command: Command[Scalar]
    status: jax.Array


@dataclasses.dataclass(frozen=True)
class Source:
    """Header and source of one part.

    Attributes:
        header: text of the header.
        source: text of the source.
        functions: C functions by name.
        shared: functions that these call.
        structures: C structures by name.
    """

    header: str
    source: str
    functions: dict[str, Written]
    shared: Functions
    structures: dict[str, Structure]


def autopilot_source(pilot: Pilot, about: str) -> Source:
    """The autopilot as glider.h and glider.c.

    Args:
        pilot: autopilot that runs on board, in double precision.
        about: a line for the head of the files.

    Raises:
        ExportError: it uses a primitive that has no form in C here, or is not in
            double precision.
    """
    check_precision(pilot)
    state = jax.eval_shape(pilot.init)
    sensed = isinstance(pilot, SensedAutopilot)
    measured = MeasurementInput(pilot.dt, pilot.untold())
    plan = jax.eval_shape(pilot.plan, state, pilot.dt)
    structures = {
        "parameters": Structure(
            "glider_parameters", "Gains, design model, task and limits.", pilot
        ),
        "state": Structure(
            "glider_state",
            "What one tick hands to the next. Start with glider_init.",
            state,
        ),
        "measurement": Structure(
            "glider_measurement",
            "Newest samples of the sensors; NaN where a number is missing."
            if sensed
            else "What was measured at the start of the tick; NaN where it is missing.",
            measured,
            hidden=("told", "sensed", "value"),
            origins=ORIGINS,
        ),
        "reference": Structure(
            "glider_reference",
            "What the task asks for: from glider_plan, or your own numbers.",
            plan,
        ),
        "command": Structure(
            "glider_command",
            "What the actuators are asked for.",
            CommandOutput(zeros(Command, pilot.dt), jnp.zeros((), jnp.int32)),
            hidden=("command",),
        ),
    }
    shared = Functions()
    functions = _autopilot_functions(pilot, structures, shared)
    return Source(
        header=header_text("glider", about, structures, functions, _status_text(pilot)),
        source=source_text("glider", about, pilot, functions, shared),
        functions=functions,
        shared=shared,
        structures=structures,
    )


def _autopilot_functions(
    pilot: Pilot, structures: dict[str, Structure], shared: Functions
) -> dict[str, Written]:
    def init(p: Pilot) -> Any:
        return p.init()

    def plan(p: Pilot, state: Any, m: MeasurementInput) -> Any:
        return p.plan(state, m.time)

    def step(
        p: Pilot, state: Any, m: MeasurementInput, planned: Any
    ) -> tuple[Any, CommandOutput]:
        after, command, status = p.step(state, m.time, m.told, planned)
        return after, CommandOutput(command, status)

    state, measurement = structures["state"], structures["measurement"]
    parameters = (CONSTANTS["glider"], pilot)
    return {
        "glider_init": write_function(
            "glider_init",
            "Sets the state before the first tick.",
            init,
            parameters,
            [Argument("state", state, reads=False, writes=True)],
            shared,
        ),
        "glider_plan": write_function(
            "glider_plan",
            "What the task that was exported asks for at the time of a measurement.",
            plan,
            parameters,
            [
                Argument("state", state),
                Argument("measurement", measurement),
                Argument(
                    "reference", structures["reference"], reads=False, writes=True
                ),
            ],
            shared,
        ),
        "glider_step": write_function(
            "glider_step",
            "One control tick, to be called every GLIDER_DT seconds.",
            step,
            parameters,
            [
                Argument("state", state, writes=True),
                Argument("measurement", measurement),
                Argument("reference", structures["reference"]),
                Argument("command", structures["command"], reads=False, writes=True),
            ],
            shared,
        ),
    }


def check_precision(tree: Any) -> None:
    """Refuse what is not in double precision.

    Raises:
        ExportError: it is not.
    """
    kinds = {str(x.dtype) for x in jax.tree.leaves(tree)}
    if "float32" in kinds or "float64" not in kinds:
        raise ExportError(
            "export needs a controller in double precision; received "
            f"{', '.join(sorted(kinds))}. Build it with jax_enable_x64; the C code "
            "itself can then be compiled for either precision."
        )


def _status_text(pilot: Pilot) -> str:
    lines = [
        f"/* The control tick [s]. */\n#define GLIDER_DT {float(pilot.dt)!r}\n",
        "/* Taken off measured positions in double precision, at once: the rest, in "
        "single\n   precision too, is about small numbers [m]. */",
        f"#define GLIDER_ORIGIN_NORTH {pilot.origin.north!r}",
        f"#define GLIDER_ORIGIN_EAST {pilot.origin.east!r}\n",
        "/* Bits of the status word. */",
        "enum {",
    ]
    last = list(BITS)[-1]
    for name, bit in BITS.items():
        comma = "" if name == last else ","
        lines.append(f"    GLIDER_{name.upper()} = {bit}{comma} /* {STATUS[name]} */")
    return "\n".join(lines).rstrip() + "\n};\n"


def header_text(
    stem: str,
    about: str,
    structures: dict[str, Structure],
    functions: dict[str, Written],
    middle: str = "",
) -> str:
    """The text of a header.

    Args:
        stem: stem of the file's name.
        about: a line for its head.
        structures: structures, the one of the parameters among them.
        functions: C functions by name.
        middle: text that comes before the structures.
    """
    guard = f"{stem.upper()}_H"
    declarations = "\n".join(s.declaration() for s in structures.values())
    prototypes = "\n".join(
        f"/* {f.summary} */\n{f.prototype};\n" for f in functions.values()
    )
    opening = '#ifdef __cplusplus\nextern "C" {\n#endif\n'
    closing = "#ifdef __cplusplus\n}\n#endif\n"
    return (
        f"/* {about} */\n#ifndef {guard}\n#define {guard}\n\n"
        f'#include "glider_real.h"\n\n{opening}\n{middle}\n{declarations}\n'
        f"extern const {stem}_parameters {CONSTANTS[stem]};\n\n{prototypes}\n"
        f"{closing}\n#endif\n"
    )


def source_text(
    stem: str,
    about: str,
    parameters: Any,
    functions: dict[str, Written],
    shared: Functions,
) -> str:
    """The text of a source file; arguments as for `header_text`.

    Args:
        stem: stem of the file's name.
        about: a line for its head.
        parameters: pytree of the constants.
        functions: C functions by name.
        shared: functions that these call.
    """
    constants = constants_text(f"{stem}_parameters", CONSTANTS[stem], parameters)
    texts = "\n".join(f.text for f in functions.values())
    return (
        f'/* {about} */\n#include "{stem}.h"\n\n{constants}\n'
        f"{helper_text(shared)}\n{texts}"
    )
