"""Parts of a first and of a second start: `python benchmarks/bench_first_run.py`.

Commands, and one rollout and one gradient from Python, each in a process of its own:
first with an empty cache of compiled programs, then with the one that this has left.
JAX tells of every program how long it took to trace, to lower and to compile (from a
full cache: to load); what is inside another one counts there. The rest is running
programs and writing reports. With a second thread that compiles, the parts may add up
to more than the whole.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any, NamedTuple

BEGUN = time.perf_counter()

# A command starts JAX itself, as for a user, without what other benchmarks set.
CHILD = "--child" in sys.argv
ENVIRONMENT = dict(os.environ)
ENVIRONMENT.pop("JAX_COMPILATION_CACHE_DIR", None)
if not CHILD:
    import measuring

PARTS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile",
}
WORTH_A_ROW = 0.5
"""Programs that took less [s] share one row."""
STARTS = {
    "rollout": ["rollout"],
    "gradient": ["gradient"],
    "simulate": ["simulate", "--config", "mission.toml", "--out", "out"],
    "compare": ["compare", "--out", "out"],
    "tune --steps 1": ["tune", "--steps", "1", "--out", "out"],
}


FROM_PYTHON = ("rollout", "gradient")


class Span(NamedTuple):
    """Some work on one program.

    Attributes:
        thread: number of the thread that did it.
        part: kind of work: trace, lower or compile.
        program: name of the program.
        begun: start [s].
        seconds: duration [s].
    """

    thread: int
    part: str
    program: str
    begun: float
    seconds: float

    def holds(self, other: "Span") -> bool:
        """Whether the other one went on within this one."""
        return (
            self is not other
            and self.thread == other.thread
            and self.begun <= other.begun
            and other.begun + other.seconds <= self.begun + self.seconds
        )


def listen() -> list[Span]:
    """A list that grows with every program that JAX works on."""
    import jax

    spans: list[Span] = []

    def heard(event: str, seconds: float, **about: Any) -> None:
        if event in PARTS:
            begun = time.perf_counter() - seconds
            name = str(about.get("fun_name", "?")).removeprefix("jit(").rstrip(")")
            thread = threading.get_ident()
            spans.append(Span(thread, PARTS[event], name, begun, seconds))

    jax.monitoring.register_event_duration_secs_listener(heard)
    return spans


def outermost(spans: list[Span]) -> list[Span]:
    """Those that went on within no other."""
    ordered = sorted(spans, key=lambda span: (span.thread, span.begun, -span.seconds))
    kept: list[Span] = []
    for span in ordered:
        if not kept or not kept[-1].holds(span):
            kept.append(span)
    return kept


def from_python(kind: str) -> None:
    """A rollout or a gradient of the default loop, as in the README."""
    import jax

    import jaxglider
    from jaxglider import paper

    jaxglider.enable_fast_loops()
    jax.config.update("jax_enable_x64", True)
    loop = paper.make_loop("switching", "rigid-body", "fxtppc-roll")
    sea = loop.scenario.sea(jax.random.key(0))

    def pitch_error(loop: Any) -> Any:
        return jaxglider.evaluate(loop, sea).channels.pitch.rms_error

    function = pitch_error if kind == "rollout" else jax.grad(pitch_error)
    jax.block_until_ready(jax.jit(function)(loop))


def child(words: list[str]) -> None:
    """In a process of its own: one start, as JSON on the last line."""
    run: Callable[[], Any]
    if words[0] in FROM_PYTHON:
        import jaxglider.paper  # noqa: F401

        run = lambda: from_python(words[0])
    else:
        from tuning.cli.main import main as command

        run = lambda: command(words)
    imported = time.perf_counter() - BEGUN
    spans = listen()
    run()
    whole = time.perf_counter() - BEGUN
    programs: dict[str, dict[str, float]] = defaultdict(
        lambda: dict.fromkeys(PARTS.values(), 0.0)
    )
    for span in outermost(spans):
        programs[span.program][span.part] += span.seconds
    parts = {part: sum(p[part] for p in programs.values()) for part in PARTS.values()}
    told = {
        "import_s": imported,
        **{f"{part}_s": seconds for part, seconds in parts.items()},
        "rest_s": max(whole - imported - sum(parts.values()), 0.0),
        "whole_s": whole,
        "processor_s": time.process_time(),
        "programs": programs,
    }
    print("\n" + json.dumps(told))


def start(words: list[str], cache: str, folder: str) -> dict[str, Any]:
    """One start in an empty folder that has a mission file in it."""
    # A command finds its own folders for compiled and traced programs, Python has none.
    caches = {"XDG_CACHE_HOME": cache}
    if words[0] in FROM_PYTHON:
        caches["JAX_COMPILATION_CACHE_DIR"] = cache
    command = [sys.executable, "-m", "tuning", "init"]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    done = subprocess.run(
        [sys.executable, __file__, "--child", *words],
        cwd=folder,
        env={**ENVIRONMENT, **caches},
        capture_output=True,
        check=True,
        encoding="utf-8",
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measure(names: list[str]) -> list[dict[str, Any]]:
    """Every start with an empty cache and with a full one."""
    rows = []
    for name in names:
        with tempfile.TemporaryDirectory() as cache:
            for state in ("empty", "full"):
                with tempfile.TemporaryDirectory() as folder:
                    told = start(STARTS[name], cache, folder)
                measuring.say(f"{name}, {state} cache: {told['whole_s']:.1f} s")
                rows.append({"start": name, "cache": state, **told})
    return rows


def tables(rows: list[dict[str, Any]]) -> str:
    """Starts, then the programs of each."""
    keys = ("import", "trace", "lower", "compile", "rest", "whole", "processor")
    starts = [
        [f"{row['start']}, {row['cache']} cache", *(row[f"{key}_s"] for key in keys)]
        for row in rows
    ]
    titles = ("start", *(f"{key} s" for key in keys))
    return "\n\n".join(
        [
            measuring.markdown(titles, starts),
            measuring.markdown(
                ("program", "trace s", "lower s", "compile s"), _programs(rows)
            ),
        ]
    )


def _programs(rows: list[dict[str, Any]]) -> list[list[Any]]:
    lines = []
    for row in rows:
        small = dict.fromkeys(PARTS.values(), 0.0)
        where = f"{row['start']}, {row['cache']} cache"
        for name, parts in row["programs"].items():
            if sum(parts.values()) >= WORTH_A_ROW:
                lines.append([f"{where}: `{name}`", *parts.values()])
            else:
                small = {key: small[key] + parts[key] for key in small}
        lines.append([f"{where}: all others", *small.values()])
    return lines


def draw(rows: list[dict[str, Any]], options: argparse.Namespace) -> None:
    """The parts of each start, one after the other."""
    whole, (panel,) = measuring.drawing(1)
    names = [f"{row['start']}\n{row['cache']} cache" for row in rows]
    begun = [0.0] * len(rows)
    for part in ("import", "trace", "lower", "compile", "rest"):
        spent = [row[f"{part}_s"] for row in rows]
        panel.barh(names, spent, left=begun, label=part)
        begun = [a + b for a, b in zip(begun, spent, strict=True)]
    panel.invert_yaxis()
    panel.set_xlabel("s")
    panel.tick_params(axis="y", labelsize=6)
    panel.legend(frameon=False, fontsize=7)
    measuring.save(whole, "from the start of Python to the last report", options.plot)


def main() -> int:
    """Measure and print tables, or JSON."""
    parser = measuring.arguments(__doc__)
    parser.set_defaults(precision=64)
    parser.add_argument("--starts", nargs="+", choices=tuple(STARTS), metavar="START")
    options = parser.parse_args()
    names = options.starts or (["rollout"] if options.quick else list(STARTS))
    rows = measure(names)
    if options.plot is not None:
        draw(rows, options)
    measuring.conclude(options, {"starts": rows}, tables(rows))
    return 0


if __name__ == "__main__":
    if CHILD:
        child(sys.argv[sys.argv.index("--child") + 1 :])
    else:
        sys.exit(main())
