"""Seconds to trace and to compile: `python benchmarks/bench_compile.py`.

Rollouts of every controller on both plants, and gradients by reverse mode, each traced
and compiled anew. Then the same rollout and gradient in processes of their own that
share a persistent cache, empty at first: what the second start of a program costs.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

BEGUN = time.perf_counter()

import jax
import measuring
from jax.flatten_util import ravel_pytree

from jaxglider import evaluate, paper


def programs(controller: str, plant: str, lanes: int) -> dict[str, Any]:
    """A rollout and a gradient of one block of lanes, with their inputs."""
    loop, sea = measuring.case(controller, plant, 16000)
    nominal = loop.scenario.plant.parameters
    members = measuring.draw_members(nominal, lanes, 32)
    _, rebuild = ravel_pytree(nominal)
    rows = jax.vmap(lambda p: ravel_pytree(p)[0])(members)

    def loss(row: jax.Array) -> jax.Array:
        where = lambda at: at.scenario.plant.parameters
        changed = measuring.eqx.tree_at(where, loop, rebuild(row))
        return evaluate(changed, sea).channels.heading.rms_error

    return {
        "rollout": (measuring.batch_of(evaluate, loop, sea), members),
        "gradient": (
            lambda x: measuring.map_members(jax.value_and_grad(loss), x),
            rows,
        ),
    }


def in_this_process(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Trace and compile everything once."""
    rows = []
    for controller in options.controllers:
        for plant in options.plants:
            given = programs(controller, plant, options.lanes)
            for kind in ("rollout", "gradient"):
                if kind == "gradient" and (controller, plant) not in options.gradients:
                    continue
                function, inputs = given[kind]
                _, cost = measuring.compiled(function, inputs)
                row = {"program": kind, "controller": controller, "plant": plant}
                measuring.say(f"{row}: {cost['trace_s']:.1f} + {cost['compile_s']:.1f}")
                rows.append({**row, **cost})
    return rows


def child(kind: str, lanes: int) -> None:
    """In a process of its own: what a start costs, as JSON."""
    imported = time.perf_counter() - BEGUN
    function, inputs = programs("fxtppc", "printed", lanes)[kind]
    program, cost = measuring.compiled(function, inputs)
    jax.block_until_ready(program(inputs))
    whole = time.perf_counter() - BEGUN
    print(json.dumps({"import_s": imported, **cost, "whole_s": whole}))


def with_cache(kind: str, lanes: int) -> dict[str, Any]:
    """A start with an empty persistent cache and one with a full one."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {
            **os.environ,
            "JAX_COMPILATION_CACHE_DIR": folder,
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        }
        command = [sys.executable, __file__, "--child", kind, "--lanes", str(lanes)]
        starts = [
            json.loads(
                subprocess.run(
                    command, env=environment, capture_output=True, check=True
                ).stdout
            )
            for _ in range(2)
        ]
    return {"program": kind, "cold": starts[0], "warm": starts[1]}


def tables(result: dict[str, Any]) -> str:
    """Trace and compile apart; cold and warm starts."""
    titles = ("program", "controller", "plant", "trace s", "compile s")
    keys = ("program", "controller", "plant", "trace_s", "compile_s")
    fresh = [[row[key] for key in keys] for row in result["fresh"]]
    starts = [
        [f"{row['program']}, {state} cache", *(row[state][key] for key in parts)]
        for parts in [("import_s", "trace_s", "compile_s", "whole_s")]
        for row in result["starts"]
        for state in ("cold", "warm")
    ]
    heads = ("start of a process", "import s", "trace s", "compile s", "whole s")
    return "\n\n".join(
        [measuring.markdown(titles, fresh), measuring.markdown(heads, starts)]
    )


def draw(result: dict[str, Any], options: argparse.Namespace) -> None:
    """Trace and compile, one on the other."""
    whole, (left, right) = measuring.drawing(2)
    rows = result["fresh"]
    names = [f"{r['program']}\n{r['controller']}, {r['plant']}" for r in rows]
    left.barh(names, [r["trace_s"] for r in rows], label="trace")
    left.barh(
        names,
        [r["compile_s"] for r in rows],
        left=[r["trace_s"] for r in rows],
        label="compile",
    )
    states = [(r, s) for r in result["starts"] for s in ("cold", "warm")]
    names = [f"{r['program']}\n{state} cache" for r, state in states]
    begun = [0.0] * len(states)
    for part in ("import_s", "trace_s", "compile_s"):
        spent = [r[state][part] for r, state in states]
        right.barh(names, spent, left=begun, label=part.removesuffix("_s"))
        begun = [a + b for a, b in zip(begun, spent, strict=True)]
    for panel in (left, right):
        panel.invert_yaxis()
        panel.set_xlabel("s")
        panel.tick_params(axis="y", labelsize=6)
        panel.legend(frameon=False, fontsize=7)
    measuring.save(whole, f"{options.lanes} lanes, float32", options.plot)


def main() -> int:
    """Measure and print tables, or JSON."""
    parser = measuring.arguments(__doc__)
    parser.add_argument("--lanes", type=int, default=64)
    parser.add_argument("--child", choices=("rollout", "gradient"))
    options = parser.parse_args()
    if options.child:
        child(options.child, options.lanes)
        return 0
    options.controllers, options.plants = paper.CONTROLLERS[::-1], tuple(paper.PLANTS)
    options.gradients = [("fxtppc", plant) for plant in options.plants]
    kinds = ["rollout", "gradient"]
    if options.quick:
        options.controllers, options.plants = ("fxtppc",), ("printed",)
        options.gradients, kinds = [], ["rollout"]
    result = {
        "fresh": in_this_process(options),
        "starts": [with_cache(kind, options.lanes) for kind in kinds],
    }
    if options.plot is not None:
        draw(result, options)
    measuring.conclude(options, result, tables(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
