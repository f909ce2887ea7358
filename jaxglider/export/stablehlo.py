"""The autopilot as StableHLO, for runtimes of XLA and MLIR."""

import dataclasses
import json
from typing import Any

import jax
import jax.numpy as jnp
from jax import export

from jaxglider.export.c.fields import Field, fields_of
from jaxglider.onboard.of_loop import Pilot
from jaxglider.onboard.samples import Samples
from jaxglider.simulation.origin import Origin


def stablehlo(pilot: Pilot) -> dict[str, str]:
    """Three functions of scalars as text of MLIR, and what their arguments are.

    Gains are constants in it, and measured positions are true ones. Arguments and
    results are in the order of the JSON file.

    Args:
        pilot: the autopilot.

    Returns:
        Texts by name of file.
    """
    state = jax.eval_shape(pilot.init)
    time = jnp.zeros_like(pilot.dt)
    measured = pilot.untold()
    planned = jax.eval_shape(pilot.plan, state, time)

    def step(state: Any, time: Any, measured: Any, planned: Any) -> Any:
        return pilot.step(state, time, _off_the_map(measured, pilot.origin), planned)

    functions: dict[str, tuple[Any, dict[str, Any], tuple[str, ...]]] = {
        "init": (pilot.init, {}, ("state",)),
        "plan": (pilot.plan, {"state": state, "time": time}, ("reference",)),
        "step": (
            step if pilot.origin.moved else pilot.step,
            {"state": state, "time": time, "measured": measured, "reference": planned},
            ("state", "command", "status"),
        ),
    }
    texts, about = {}, {}
    for name, (function, inputs, results) in functions.items():
        leaves, form = jax.tree.flatten(tuple(inputs.values()))

        def flat(*x: Any, function: Any = function, form: Any = form) -> list[Any]:
            return jax.tree.leaves(function(*jax.tree.unflatten(form, x)))

        shapes = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in leaves]
        exported = export.export(jax.jit(flat, keep_unused=True))(*shapes)
        texts[f"glider_{name}.mlir"] = exported.mlir_module()
        outputs = jax.eval_shape(function, *inputs.values())
        outputs = outputs if len(results) > 1 else (outputs,)
        about[name] = {
            "arguments": [n for k, tree in inputs.items() for n in _named(k, tree)],
            "results": [
                n
                for k, tree in zip(results, outputs, strict=True)
                for n in _named(k, tree)
            ],
        }
    return {**texts, "arguments.json": json.dumps(about, indent=2) + "\n"}


def _off_the_map(measured: Any, origin: Origin) -> Any:
    """A measurement, or samples, from true positions."""
    if isinstance(measured, Samples):
        fix = measured.fix and _off_the_map(measured.fix, origin)
        return dataclasses.replace(measured, fix=fix)
    return dataclasses.replace(
        measured,
        north=measured.north - origin.north,
        east=measured.east - origin.east,
    )


def _named(name: str, tree: Any) -> list[dict[str, str]]:
    def entry(field: Field) -> dict[str, str]:
        whole = name if field.name == "value" else f"{name}.{field.name}"
        return {"name": whole, "kind": field.kind, "is": field.comment}

    return [entry(f) for f in fields_of(tree)]
