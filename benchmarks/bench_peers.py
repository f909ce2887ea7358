"""jaxglider beside C, numba, NumPy and diffrax: `python benchmarks/bench_peers.py`.

The same closed loop in all of them, every metric included: FxTPPC with its observer and
the paper's gains, printed plant, 20 Hz, the switching case; members differ in all
uncertain parameters. First all must agree with jaxglider in double precision, then in
the precision that is timed; otherwise nothing is timed and the exit code is 1. What is
not installed (numba, diffrax: `pip install -e .[bench]`) or not there (gcc) is said and
left out.
"""

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import measuring
import numpy as np
from peers import c, numpy_loop
from peers.problem import METRICS, Problem, metric_rows, parameter_rows

import jaxglider

JAXGLIDER, BEST_C, PLAIN_C = "jaxglider", "C, best", "C, plain"
TOLERANCE = {64: (1e-9, 1e-12), 32: (1e-4, 1e-5)}
"""Relative and absolute; shares of time may differ by one tick besides."""

Evaluate = Callable[[np.ndarray, int, int], np.ndarray]
"""Metrics from parameter rows, ticks and cores."""


class Setting:
    """One precision: the closed loop, its members, and the peers that can run it."""

    def __init__(self, precision: int, members: int, ticks: int) -> None:
        self.kind = np.float64 if precision == 64 else np.float32
        self.precision = precision
        self.wide = lambda: jax.enable_x64(precision == 64)
        with self.wide():
            loop, sea = measuring.case("fxtppc", "printed", ticks)
            self.problem = Problem.of(loop, sea, self.kind)
            self.members = measuring.draw_members(
                loop.scenario.plant.parameters, members, precision
            )
        self.rows = parameter_rows(self.members, self.kind)

    def first(self, count: int) -> np.ndarray:
        """Parameter rows of the first members."""
        return np.ascontiguousarray(self.rows[:, :count])

    def traced(
        self, evaluate: Any, count: int, ticks: int, cores: int
    ) -> Callable[[], Any]:
        """A compiled run of a peer that is written in JAX."""
        with self.wide():
            loop, sea = measuring.case("fxtppc", "printed", ticks)
            devices = jax.devices()[:cores] if cores > 1 else None
            members = jax.tree.map(lambda x: x[:count], self.members)
            members = measuring.spread(members, devices)
            batch = measuring.batch_of(evaluate, loop, sea, devices)
            program, _ = measuring.compiled(batch, members)

        def run() -> Any:
            with self.wide():
                return jax.block_until_ready(program(members))

        return run


def host_peers(names: list[str]) -> dict[str, Any]:
    """Peers that take plain arrays, as far as they are there."""
    found: dict[str, Any] = {
        BEST_C: c.evaluate,
        PLAIN_C: lambda *given: c.evaluate(*given, flags=c.PLAIN),
        "NumPy": numpy_loop.evaluate,
    }
    try:
        c.library(c.PLAIN, 64, c.LANES)
    except c.CompilerError as error:
        measuring.say(f"without C: {error}")
        del found[BEST_C], found[PLAIN_C]
    try:
        from peers import numba_loop

        found["numba"] = numba_loop.evaluate
    except ImportError as error:
        measuring.say(f"without numba: {error}")
    return {name: peer for name, peer in found.items() if name in names}


def traced_peers(names: list[str]) -> dict[str, Any]:
    """Peers that are written in JAX, as far as they are there."""
    found: dict[str, Any] = {JAXGLIDER: jaxglider.evaluate}
    try:
        from peers import diffrax_loop

        found["diffrax"] = diffrax_loop.evaluate
    except ImportError as error:
        measuring.say(f"without diffrax: {error}")
    return {name: peer for name, peer in found.items() if name in names}


def disagreements(
    reference: np.ndarray, found: np.ndarray, precision: int, ticks: int
) -> list[str]:
    """Metrics that differ by more than rounding, with the worst difference of each."""
    relative, absolute = TOLERANCE[precision]
    bad = []
    for name, wanted, got in zip(METRICS, reference, found, strict=True):
        allowed = relative * np.abs(wanted) + absolute
        if ".time_" in name:
            allowed = allowed + 1.001 / ticks
        # Where no funnel has settled, the programs by hand say 0 and jaxglider NaN.
        unsettled = np.isnan(wanted) & (np.isnan(got) | (got == 0.0))
        excess = np.where(unsettled, 0.0, np.abs(got - wanted) - allowed)
        if not np.all(excess <= 0.0):
            worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
            bad.append(f"{name}: {got[worst]:.9g} for {wanted[worst]:.9g}")
    return bad


def check(peers: tuple[dict, dict], precision: int, ticks: int, members: int) -> bool:
    """Whether all agree with jaxglider in double precision; says which do not.

    A glider that rolls past 90 degrees magnifies rounding: it is compared in double
    precision only.
    """
    hosts, traced = peers
    double = Setting(64, members, ticks)
    run = double.traced(jaxglider.evaluate, members, ticks, 1)
    reference = metric_rows(run())
    upright = reference[METRICS.index("max_roll")] < 0.5 * np.pi
    good = True
    for bits in sorted({64, precision}, reverse=True):
        setting = double if bits == 64 else Setting(bits, members, ticks)
        results = {
            name: peer(setting.problem, setting.first(members), ticks, 1)
            for name, peer in hosts.items()
        }
        for name, peer in traced.items():
            if bits != 64 or name != JAXGLIDER:
                run = setting.traced(peer, members, ticks, 1)
                results[name] = metric_rows(run())
        kept = upright if bits == 32 else np.full_like(upright, True)
        for name, found in results.items():
            bad = disagreements(reference[:, kept], found[:, kept], bits, ticks)
            good = good and not bad
            verdict = "agrees" if not bad else "DISAGREES: " + "; ".join(bad)
            measuring.say(f"float{bits} {name}: {verdict} ({kept.sum()} members)")
    return good


def horizon(run: Callable[[int], Any], most: int, seconds: float) -> int:
    """Ticks that a peer does in about the given time."""
    ticks = min(20, most)
    run(ticks)
    while True:
        begun = time.perf_counter()
        run(ticks)
        spent = time.perf_counter() - begun
        if ticks == most or spent > 0.1 * seconds:
            return int(min(most, max(20, ticks * seconds / spent)))
        ticks = min(most, 4 * ticks)


def measure(
    peers: tuple[dict, dict], setting: Setting, count: int, cores: int, options: Any
) -> dict[str, Any]:
    """Million ticks per second of each peer at one batch, and over the best C."""
    hosts, traced = peers
    rows, runs, ticks = setting.first(count), {}, {}
    for name, peer in hosts.items():
        if cores > 1 and name == "NumPy":
            continue

        def run(n: int, peer: Any = peer) -> Any:
            return peer(setting.problem, rows, n, cores)

        ticks[name] = horizon(run, options.ticks, options.seconds)
        runs[name] = lambda run=run, n=ticks[name]: run(n)
    for name, peer in traced.items():
        ticks[name] = options.ticks if name == JAXGLIDER else options.diffrax_ticks
        runs[name] = setting.traced(peer, count, ticks[name], cores)
    seconds = measuring.in_turn(runs, options.repeats)
    per_tick = {n: [s / ticks[n] / count for s in seconds[n]] for n in runs}
    result = {}
    for name in runs:
        middle = float(np.median(per_tick[name]))
        result[name] = {
            "million_ticks_per_s": 1e-6 / middle,
            "ticks": ticks[name],
            "spread": measuring.spread_of(seconds[name]),
        }
        if BEST_C in runs:
            ratio = measuring.median_ratio(per_tick[BEST_C], per_tick[name])
            result[name]["over_best_c"] = ratio
    return result


def tables(result: dict[str, Any]) -> str:
    """Speeds of all peers, and jaxglider over the best C."""
    rows = result["speed"]
    names = list(dict.fromkeys(name for row in rows for name in row["peers"]))
    titles = ["million ticks/s", *names, "jaxglider over best C"]
    body = []
    for row in rows:
        got = row["peers"]
        speeds = [got.get(n, {}).get("million_ticks_per_s") for n in names]
        ratio = got.get(JAXGLIDER, {}).get("over_best_c")
        cores = f"{row['cores']} core" + ("s" if row["cores"] > 1 else "")
        body.append([f"batch {row['batch']}, {cores}", *speeds, ratio])
    return measuring.markdown(titles, body)


def draw(result: dict[str, Any], options: argparse.Namespace) -> None:
    """Speed against batch on one core, and on all."""
    cores = sorted({row["cores"] for row in result["speed"]})
    peers = dict.fromkeys(n for row in result["speed"] for n in row["peers"])
    colours = {name: f"C{i}" for i, name in enumerate(sorted(peers))}
    whole, axes = measuring.drawing(len(cores))
    for panel, number in zip(axes, cores, strict=True):
        rows = [row for row in result["speed"] if row["cores"] == number]
        for name, colour in colours.items():
            points = [
                (row["batch"], row["peers"][name]["million_ticks_per_s"])
                for row in rows
                if name in row["peers"]
            ]
            if points:
                size, speed = zip(*points, strict=True)
                panel.loglog(size, speed, "o-", ms=3, color=colour, label=name)
        measuring.label_sizes(panel, [row["batch"] for row in rows])
        panel.set_xlabel("members")
        panel.set_title(f"{number} core" + ("s" if number > 1 else ""), fontsize=9)
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("million ticks/s")
    whole.legend(*axes[0].get_legend_handles_labels(), loc="outside right", fontsize=7)
    title = f"closed loop, FxTPPC, printed plant, float{options.precision}"
    measuring.save(whole, title, options.plot)


def main() -> int:
    """Check, measure, and print a table, or JSON."""
    parser = measuring.arguments(__doc__)
    everything = [JAXGLIDER, BEST_C, PLAIN_C, "numba", "NumPy", "diffrax"]
    parser.add_argument("--peers", nargs="+", default=everything, choices=everything)
    parser.add_argument(
        "--batches", type=int, nargs="+", default=[1, 16, 64, 256, 1024]
    )
    parser.add_argument("--cores", type=int, nargs="+", default=[1, measuring.CORES])
    parser.add_argument("--ticks", type=int, default=16000, help="most ticks of a run")
    parser.add_argument("--diffrax-ticks", type=int, default=1000)
    parser.add_argument("--check-ticks", type=int, default=1000)
    parser.add_argument("--check-members", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=0.3, help="of one run")
    options = parser.parse_args()
    if options.quick:
        options.batches, options.repeats, options.seconds = [1, 64], 3, 0.1
        options.ticks, options.diffrax_ticks = 2000, 500
    peers = host_peers(options.peers), traced_peers(options.peers)
    if not check(peers, options.precision, options.check_ticks, options.check_members):
        measuring.say("the peers disagree: nothing was timed.")
        return 1
    result: dict[str, Any] = {"speed": []}
    setting = Setting(options.precision, max(options.batches), options.ticks)
    for cores in sorted({min(n, measuring.CORES) for n in options.cores}):
        for count in options.batches:
            if cores > 1 and count < 64:
                continue
            measuring.say(f"batch {count}, cores {cores}")
            got = measure(peers, setting, count, cores, options)
            result["speed"].append({"batch": count, "cores": cores, "peers": got})
    if options.plot is not None:
        draw(result, options)
    measuring.conclude(options, result, tables(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
