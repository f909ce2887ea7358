"""Cost of a gradient: `python benchmarks/bench_gradient.py`.

Value and gradient of an ensemble objective over the value alone, measured in turn, for
reverse mode and for forward mode (a lane for each member and gain), against members and
number of gains; the working memory of both against the horizon. The switching case at
20 Hz; the gains are all floats of controller and observer, k₁ and k₂ first.
"""

import argparse
import sys
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import measuring
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxglider import evaluate, map_members
from jaxglider.simulation.rollout import sparse_checkpoints


class Objective:
    """Mean tracking error of an ensemble, as a function of some of the gains."""

    def __init__(self, options: argparse.Namespace, count: int, ticks: int) -> None:
        self.loop, self.sea = measuring.case("fxtppc", options.plant, ticks)
        nominal = self.loop.scenario.plant.parameters
        self.members = measuring.draw_members(nominal, count, options.precision)
        self.flat, self.rebuild = ravel_pytree(self._gains(self.loop))
        self.all_gains = self.flat.size
        self.checkpoint_every = 1

    @staticmethod
    def _gains(loop: Any) -> Any:
        law, observer = loop.controller, loop.observer
        first = [
            getattr(getattr(law.gains, channel), name)
            for channel in ("depth", "pitch", "heading")
            for name in ("k1", "k2")
        ]
        second = [
            getattr(getattr(law.gains, channel), name)
            for channel in ("depth", "pitch", "heading")
            for name in ("rho", "mu")
        ]
        return (
            *(first, second),
            *(law.funnel, law.damping),
            *(observer.proportional, observer.integral, observer.stretch),
        )

    def loss(self, gains: jax.Array, parameters: Any) -> jax.Array:
        """Of one member; `gains` replaces the first of the flat vector."""
        flat = jnp.concatenate([gains, self.flat[gains.size :]])
        changed = eqx.tree_at(
            lambda at: jax.tree.leaves(self._gains(at)),
            self.loop,
            jax.tree.leaves(self.rebuild(flat)),
        )
        where = lambda at: at.scenario.plant.parameters
        channels = evaluate(
            eqx.tree_at(where, changed, parameters),
            self.sea,
            checkpoint_every=self.checkpoint_every,
        ).channels
        return (
            channels.depth.rms_error / 0.12
            + channels.pitch.rms_error / 0.05
            + channels.heading.rms_error / 0.2
        )

    def value(self, gains: jax.Array) -> jax.Array:
        """The rollout alone."""
        return map_members(lambda p: self.loss(gains, p), self.members).mean()

    def reverse(self, gains: jax.Array, **options: Any) -> tuple[jax.Array, jax.Array]:
        """Value and gradient by reverse mode; options of `map_members`."""
        each = jax.value_and_grad(self.loss)
        values, slopes = map_members(lambda p: each(gains, p), self.members, **options)
        return values.mean(), slopes.mean(axis=0)

    def forward(self, gains: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The same by forward mode, a lane for each member and gain."""
        count, size = jax.tree.leaves(self.members)[0].shape[0], gains.size
        lanes = (
            jax.tree.map(lambda x: jnp.repeat(x, size, axis=0), self.members),
            jnp.tile(jnp.eye(size, dtype=gains.dtype), (count, 1)),
        )

        def slope(lane: Any) -> tuple[jax.Array, jax.Array]:
            parameters, direction = lane
            return jax.jvp(lambda g: self.loss(g, parameters), (gains,), (direction,))

        values, slopes = map_members(slope, lanes)
        return values.mean(), slopes.reshape(count, size).mean(axis=0)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    rows = []
    for count in options.members:
        objective = Objective(options, count, options.ticks)
        sizes = [n for n in options.gains if n < objective.all_gains]
        programs: dict[str, tuple[Callable[..., Any], int]] = {
            "reverse": (objective.reverse, objective.all_gains)
        }
        if count in options.forward_members:
            for size in (*sizes, objective.all_gains):
                programs[f"forward {size}"] = (objective.forward, size)
        rows += compare(objective, programs, count, options)
    horizons = [options.ticks // 16, options.ticks // 4, options.ticks]
    memory = [memory_of(options, ticks) for ticks in horizons]
    forward = [r for r in rows if r["mode"] == "forward" and r["members"] == 1]
    return {
        "ratios": rows,
        "memory": memory,
        "exponent_of_gains_forward": measuring.fitted(forward, "gains", "seconds"),
        "exponent_of_horizon_reverse_memory": measuring.fitted(
            memory, "ticks", "reverse_mib"
        ),
        "exponent_of_horizon_forward_memory": measuring.fitted(
            memory, "ticks", "forward_mib"
        ),
        "exponent_of_horizon_sparse_memory": measuring.fitted(
            memory, "ticks", "sparse_mib"
        ),
    }


def compare(
    objective: Objective, programs: dict[str, Any], count: int, options: Any
) -> list[dict[str, Any]]:
    """Each gradient over the rollout, run in turn; they must agree."""
    gains = objective.flat
    value, cost = measuring.compiled(objective.value, gains)
    runs, costs = {"rollout": lambda: value(gains)}, {"rollout": cost}
    results = {}
    for name, (function, size) in programs.items():
        program, costs[name] = measuring.compiled(function, gains[:size])
        runs[name] = lambda program=program, size=size: program(gains[:size])
        results[name] = np.asarray(runs[name]()[1], float)
    for name, slope in results.items():
        reference = results["reverse"][: slope.size]
        off = np.linalg.norm(slope - reference) / np.linalg.norm(reference)
        if not off <= (1e-9 if options.precision == 64 else 1e-2):
            raise SystemExit(f"{name} differs from reverse mode by {off:.1e}.")
    seconds = measuring.in_turn(runs, options.repeats)
    rows = []
    for name, spent in seconds.items():
        mode, _, size = name.partition(" ")
        ratio = measuring.median_ratio(spent, seconds["rollout"])
        measuring.say(f"{count} members, {name}: {ratio:.3g} rollouts")
        rows.append(
            {
                "members": count,
                "mode": mode,
                "gains": int(size or (0 if mode == "rollout" else gains.size)),
                "over_rollout": ratio,
                "seconds": float(np.median(spent)),
                "spread": measuring.spread_of(spent),
                **costs[name],
            }
        )
    return rows


def memory_of(options: argparse.Namespace, ticks: int) -> dict[str, Any]:
    """Working memory of a gradient at one horizon, for one member and six gains."""
    objective = Objective(options, 1, ticks)
    gains = objective.flat[:6]

    def mib(function: Callable[..., Any]) -> float:
        return measuring.compiled(function, gains)[1]["memory_mib"]

    found = {
        "reverse_mib": mib(objective.reverse),
        "forward_mib": mib(objective.forward),
    }
    objective.checkpoint_every = sparse_checkpoints(ticks)
    # Another function, or the compiled one is taken again.
    found["sparse_mib"] = mib(lambda gains: objective.reverse(gains))
    return {"ticks": ticks, **found}


def tables(result: dict[str, Any]) -> str:
    """Ratios, and memory against the horizon."""
    keys = ("members", "gains", "over_rollout", "seconds", "memory_mib")
    keys = (*keys, "trace_s", "compile_s", "spread")
    titles = ("mode", "members", "gains", "over rollout", "s", "MiB")
    titles = (*titles, "trace s", "compile s", "spread")
    rows = [[row["mode"], *(row[key] for key in keys)] for row in result["ratios"]]
    memory = [list(row.values()) for row in result["memory"]]
    fits = [
        f"{what}^{measuring.figure(result[key])}"
        for what, key in (
            ("forward time ~ gains", "exponent_of_gains_forward"),
            ("reverse memory ~ ticks", "exponent_of_horizon_reverse_memory"),
            ("forward memory ~ ticks", "exponent_of_horizon_forward_memory"),
            ("sparse memory ~ ticks", "exponent_of_horizon_sparse_memory"),
        )
    ]
    return "\n\n".join(
        [
            measuring.markdown(titles, rows),
            measuring.markdown(
                ("ticks", "reverse MiB", "forward MiB", "sparse MiB"), memory
            ),
            "; ".join(fits),
        ]
    )


def draw(result: dict[str, Any], options: argparse.Namespace) -> None:
    """Ratio against members and against gains, memory against horizon."""
    whole, (left, middle, right) = measuring.drawing(3)
    reverse = [r for r in result["ratios"] if r["mode"] == "reverse"]
    left.semilogx(
        *zip(*((r["members"], r["over_rollout"]) for r in reverse), strict=True),
        "o-",
        ms=3,
    )
    measuring.label_sizes(left, [r["members"] for r in reverse])
    left.set_xlabel("members")
    left.set_ylabel("gradient over rollout, reverse")
    left.set_ylim(bottom=0)
    for count in sorted({r["members"] for r in result["ratios"]}):
        rows = [r for r in result["ratios"] if r["members"] == count]
        points = [
            (r["gains"], r["over_rollout"]) for r in rows if r["mode"] == "forward"
        ]
        if points:
            label = f"forward, {count} member" + ("s" if count > 1 else "")
            middle.loglog(*zip(*points, strict=True), "o-", ms=3, label=label)
    for row in reverse[:1]:
        middle.axhline(row["over_rollout"], color="0.5", ls="--", label="reverse, 1")
    sizes = sorted({r["gains"] for r in result["ratios"] if r["mode"] == "forward"})
    measuring.label_sizes(middle, sizes)
    middle.set_xlabel("gains")
    middle.legend(frameon=False, fontsize=7)
    for mode in ("reverse", "forward", "sparse"):
        rows = result["memory"]
        points = ([r["ticks"] for r in rows], [r[f"{mode}_mib"] for r in rows])
        right.loglog(*points, "o-", ms=3, label=mode)
    measuring.label_sizes(right, [r["ticks"] for r in result["memory"]])
    right.set_xlabel("ticks")
    right.set_ylabel("working memory, 1 member [MiB]")
    right.legend(frameon=False, fontsize=7)
    for panel in (left, middle, right):
        panel.grid(alpha=0.3)
    measuring.save(whole, f"gradient, float{options.precision}", options.plot)


def main() -> int:
    """Measure and print tables, or JSON."""
    parser = measuring.arguments(__doc__)
    parser.add_argument("--plant", choices=("printed", "rigid-body"), default="printed")
    parser.add_argument("--members", type=int, nargs="+", default=[1, 16, 64])
    parser.add_argument("--forward-members", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--gains", type=int, nargs="+", default=[1, 6, 12])
    parser.add_argument("--ticks", type=int, default=4000)
    options = parser.parse_args()
    if options.quick:
        options.members, options.forward_members, options.gains = [1, 16], [1], [6]
        options.ticks, options.repeats = 800, 3
    jax.config.update("jax_enable_x64", options.precision == 64)
    result = measure(options)
    if options.plot is not None:
        draw(result, options)
    measuring.conclude(options, result, tables(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
