"""The exported C code does what the traced function does, tick by tick."""

import dataclasses
import re
import runpy
import shutil
import subprocess
from pathlib import Path

import compiled_c
import equinox as eqx
import jax
import numpy as np
import pytest
from compiled_c import Onboard, columns

from jaxglider import paper
from jaxglider.export import export_c
from jaxglider.export.autopilot import STRICT, TEMPLATES, autopilot_source
from jaxglider.export.bundle import refuse_idle
from jaxglider.export.c.block import ExportError
from jaxglider.export.columns import columns_text
from jaxglider.export.plant import plant_source
from jaxglider.export.vectors import broken, fly, replay, sea, window
from jaxglider.onboard.guard import BITS, Guard, status_names
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import GliderState, zeros

needs_compiler = pytest.mark.skipif(
    compiled_c.COMPILER is None, reason="no C compiler on this machine"
)
TICKS = 16_000
FUZZED = 17_000
"""For each of six exports: 102,000 in all."""


@pytest.fixture(scope="module")
def plant():
    """The glider in C; its columns depend on neither case nor law."""
    return plant_source(paper.make_loop("switching", "printed", "smc"), "test")


@pytest.fixture(scope="module", params=["switching", "waypoints"])
def course(request):
    """A case of the paper, and 800 s of what its sensors say."""
    loop = paper.make_loop(request.param, "printed", "fxtppc")
    return request.param, loop, fly(autopilot(loop), loop, sea(loop, TICKS, hold=20))[0]


def _limits(loop):
    actuators = loop.scenario.actuators
    return np.array([float(a.limit) for a in vars(actuators).values()])


@needs_compiler
@pytest.mark.parametrize("name", [*paper.CONTROLLERS, paper.ROLL_AWARE])
def test_compiled_code_follows_the_trace_even_through_faults(
    course, plant, name, tmp_path
):
    scenario, flown, seen = course
    loop = paper.make_loop(scenario, "printed", name)
    pilot = autopilot(loop, Guard(patience=0.5))
    times = np.arange(TICKS + FUZZED) * 0.05
    rows = jax.tree.map(
        lambda x: np.concatenate([x, np.asarray(x)[:1000].repeat(17)]), seen.measured
    )
    late, bad = broken(times[TICKS:], jax.tree.map(lambda x: x[TICKS:], rows), seed=1)
    times[TICKS:] = late
    rows = jax.tree.map(lambda x, b: np.concatenate([x[:TICKS], b]), rows, bad)
    # In parts of one length, each from the start: one program does for all.
    parts = [slice(n, n + 1000) for n in range(0, TICKS + FUZZED, 1000)]
    given = [(times[p], jax.tree.map(lambda x, p=p: x[p], rows)) for p in parts]
    expected = np.concatenate([columns(replay(pilot, *part)) for part in given])
    source = autopilot_source(pilot, "test")
    onboard = Onboard(tmp_path / "double", source)
    double = np.concatenate([onboard.replay(*part) for part in given])
    limits = _limits(flown)
    off = np.abs(double - expected)[:, :3] / limits
    assert off.max() < 1e-10
    np.testing.assert_array_equal(double[:, 3], expected[:, 3])
    words = {name for w in expected[TICKS:, 3] for name in status_names(int(w))}
    assert {"measurement_lost", "clock_stuck", "clock_backwards"} <= words
    assert {"clock_invalid", "clock_disbelieved", "state_reset"} <= words
    for commands in (double, expected):
        assert np.isfinite(commands).all()
        assert (np.abs(commands[:, :3]) <= limits * (1 + 1e-15)).all()
    _fuzz_sanitized(tmp_path / "double", source, plant)


def _fuzz_sanitized(folder, source, plant):
    """The fuzzer in C under sanitizers, in the folder with the sources."""
    (folder / "columns.h").write_text(columns_text(source, plant, "test", {}))
    (folder / "fuzz.c").write_text((TEMPLATES / "fuzz.c").read_text())
    flags = "-g -fsanitize=address,undefined -fno-sanitize-recover=all"
    done = subprocess.run(
        f"{compiled_c.COMPILER} {STRICT} {flags} fuzz.c glider.c -o fuzz -lm".split(),
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    ran = subprocess.run(
        ["./fuzz", "20000"], cwd=folder, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert re.search(r"20000 ticks, [1-9]\d{3,} of them spoilt", ran.stdout)


@pytest.fixture(scope="module")
def folder(course, tmp_path_factory):
    """An export as a user gets it."""
    scenario, loop, _ = course
    made = tmp_path_factory.mktemp(scenario)
    export_c(loop, f"fxtppc, {scenario}").write(made)
    return scenario, made


@needs_compiler
def test_the_controller_of_the_docs_exports_too(tmp_path):
    example = Path(__file__).parents[1] / "docs" / "examples" / "proportional.py"
    law = runpy.run_path(str(example))["Proportional"]
    loop = paper.make_loop("waypoints", controller="smc")
    own = dataclasses.replace(loop, controller=law(loop.controller.model))
    pilot = autopilot(own)
    times = np.arange(1000) * 0.05
    waves = np.sin(times[:, None] * np.arange(1, 13) / 7.0) / 3.0
    rows = jax.tree.unflatten(jax.tree.structure(zeros(GliderState)), list(waves.T))
    expected = columns(replay(pilot, times, rows))
    source = autopilot_source(pilot, "my own")
    assert "controller_stiffness_pitch" in source.header
    found = Onboard(tmp_path, source).replay(times, rows)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
    assert np.ptp(expected[:, 0]) > 0.1


def _make(folder, *targets):
    return subprocess.run(
        ["make", *targets], cwd=folder, capture_output=True, text=True
    )


needs_make = pytest.mark.skipif(
    compiled_c.COMPILER is None or shutil.which("make") is None,
    reason="no make or no C compiler on this machine",
)


@needs_make
def test_make_builds_and_passes_in_both_precisions(folder):
    _, where = folder
    done = _make(where)
    assert done.returncode == 0, done.stdout + done.stderr
    found = re.findall(r"(\w+) +test/(\w+)\.csv +(\d+) ticks.*: (\w+)", done.stdout)
    assert found == [
        ("double", "vectors", "1000", "pass"),
        ("double", "faults", "1000", "pass"),
        ("double", "closed_loop", "16000", "pass"),
        ("float", "vectors", "1000", "pass"),
        ("float", "closed_loop", "16000", "pass"),
    ]


@needs_make
@pytest.mark.parametrize("what", ["gain", "vector", "path"])
def test_make_fails_where_code_and_vectors_differ(folder, what, tmp_path):
    where = tmp_path / "spoilt"
    shutil.copytree(folder[1], where)
    name, place = {
        "gain": ("glider.c", 0),
        "vector": ("test/vectors.csv", -3),
        "path": ("test/closed_loop.csv", 8),
    }[what]
    text = (where / name).read_text()
    if what == "gain":
        changed = text.replace("pitch_k1 = REAL(0.01)", "pitch_k1 = REAL(0.0100001)")
    else:
        lines = text.splitlines()
        cells = lines[500].split(",")
        cells[place] = repr(float(cells[place]) * (1 + 1e-8))
        lines[500] = ",".join(cells)
        changed = "\n".join(lines)
    assert changed != text
    (where / name).write_text(changed)
    done = _make(where, "parity_double")
    assert done.returncode == 0
    ran = subprocess.run(["./parity_double"], cwd=where, capture_output=True, text=True)
    assert ran.returncode == 1
    assert "FAIL" in ran.stdout


@needs_make
def test_parity_says_what_it_leaves_out(folder, tmp_path):
    where = tmp_path / "short"
    shutil.copytree(folder[1], where)
    columns_h = where / "test/columns.h"
    text = columns_h.read_text()
    for name, rows in (("VECTORS", 300), ("CLOSED_LOOP", 790)):
        text = re.sub(rf"({name}_DOUBLE_ROWS) \d+", rf"\1 {rows}", text)
    columns_h.write_text(text)
    done = _make(where, "parity_double")
    assert done.returncode == 0
    ran = subprocess.run(["./parity_double"], cwd=where, capture_output=True, text=True)
    assert ran.returncode == 0
    left_out = re.findall(r"test/(\w+)\.csv: (\d+) more ticks are left out", ran.stdout)
    assert left_out == [("vectors", "700"), ("closed_loop", "200")]


@needs_make
def test_parity_fails_where_the_controller_never_steers(folder, tmp_path):
    """Vectors that it meets to the last digit, but every measurement is lost."""
    where = tmp_path / "idle"
    shutil.copytree(folder[1], where)
    vectors = where / "test/vectors.csv"
    header, *lines = vectors.read_text().splitlines()
    depth = header.split(",").index("depth")
    lost = BITS["measurement_lost"] | BITS["measurement_held"]
    rows = [line.split(",") for line in lines]
    for row in rows:
        row[depth] = "nan"
        row[-4:] = "0", "0", "0", str(lost)
    text = "\n".join(",".join(row) for row in rows)
    vectors.write_text(f"{header}\n{text}\n")
    assert _make(where, "parity_double").returncode == 0
    ran = subprocess.run(["./parity_double"], cwd=where, capture_output=True, text=True)
    assert ran.returncode == 1
    assert re.search(r"vectors.csv .*difference 0\.00e\+00.*FAIL", ran.stdout)
    assert "vectors.csv: the controller steers on 0 ticks" in ran.stdout
    assert "closed_loop.csv: the controller steers" not in ran.stdout


@pytest.mark.parametrize(
    ("scenario", "changes", "said"),
    [
        ("switching", {"speed": 1e-6}, "measurement_held and measurement_lost"),
        ("waypoints", {}, "finished"),
    ],
)
def test_an_autopilot_that_never_steers_is_not_exported(scenario, changes, said):
    """It believes no speed, or is at its last waypoint before it starts."""
    loop = paper.make_loop(scenario, "printed", "smc")
    if scenario == "waypoints":
        path = dataclasses.replace(loop.scenario.reference, north=[1.0], east=[2.0])
        own = dataclasses.replace(loop.scenario, reference=path)
        loop = dataclasses.replace(loop, scenario=own)
    pilot = autopilot(loop, Guard(patience=0.1, **changes))
    seen, _ = fly(pilot, loop, sea(loop, 1000, hold=20))
    with pytest.raises(ExportError, match=f"would not steer.*without {said}"):
        refuse_idle(seen)


def test_vectors_are_taken_before_the_mission_is_over(course):
    """Schedules restart the funnel after the last waypoint too, to no purpose."""
    ticks = np.arange(100)

    def log(status):
        return eqx.tree_at(
            lambda s: (s.time, s.status, s.segment),
            course[2],
            (ticks, status, ticks // 80),
        )

    ended = log(np.where(ticks < 60, 0, BITS["finished"]))
    assert window(ended, 20) == slice(40, 60)
    assert window(ended, 80) == slice(0, 80)
    assert window(log(0 * ticks), 20) == slice(69, 89)


def test_vectors_hold_a_restart_of_the_funnel_and_faults(folder):
    scenario, where = folder
    rows = np.genfromtxt(where / "test/vectors.csv", delimiter=",", names=True)
    assert len(rows) == 1000
    numbers = rows["number" if scenario == "switching" else "vertical_number"]
    if scenario == "switching":
        assert set(numbers) == {0, 1}
    faults = np.genfromtxt(where / "test/faults.csv", delimiter=",", names=True)
    assert np.isnan(faults["depth"]).any()
    read = faults["time"][np.isfinite(faults["time"])]
    assert (np.diff(read) <= 0).any()
    assert (faults["status"] > 0).sum() > 100


@needs_make
@pytest.mark.parametrize("course", ["waypoints"], indirect=True)
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no valgrind")
def test_valgrind_finds_nothing(folder):
    done = _make(folder[1], "valgrind")
    assert done.returncode == 0, done.stdout + done.stderr


@needs_make
@pytest.mark.parametrize("course", ["waypoints"], indirect=True)
def test_single_precision_survives_the_fuzzer_under_sanitizers(folder):
    done = _make(folder[1], "sanitize")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("150000 ticks") == 2


USE = """
#include <cmath>
#include <cstdio>
#include "glider.h"
#include "plant.h"

int main()
{
    glider_state state;
    glider_reference reference;
    glider_measurement measurement;
    glider_command command;
    plant_state glider;
    plant_init(&glider);
    measurement = glider_measurement();
    measurement.north = measurement.roll = std::nan("");
    glider_init(&state);
    glider_plan(&state, &measurement, &reference);
    glider_step(&state, &measurement, &reference, &command);
    std::printf("%d", (int)(command.status & GLIDER_MEASUREMENT_LOST));
    return 0;
}
"""


def _compile(where, command):
    done = subprocess.run(command.split(), cwd=where, capture_output=True, text=True)
    return done.returncode, done.stderr


@needs_compiler
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
@pytest.mark.parametrize("course", ["waypoints"], indirect=True)
@pytest.mark.parametrize("standard", ["c++11", "c++20"])
def test_cpp_may_include_the_headers(folder, standard, tmp_path):
    where = tmp_path / "cpp"
    shutil.copytree(folder[1], where)
    (where / "use.cpp").write_text(USE)
    for name in ("glider.c", "test/plant.c"):
        code, said = _compile(where, f"gcc {STRICT} -I. -c {name}")
        assert code == 0, said
    strict = f"-std={standard} -pedantic -Wall -Wextra -Werror -I. -Itest"
    link = f"g++ {strict} use.cpp glider.o plant.o -o use -lm"
    code, said = _compile(where, link)
    assert code == 0, said
    ran = subprocess.run(["./use"], cwd=where, capture_output=True, text=True)
    assert int(ran.stdout) > 0


@needs_compiler
@pytest.mark.parametrize("course", ["waypoints"], indirect=True)
@pytest.mark.parametrize("flag", ["-Ofast", "-ffast-math", "-ffinite-math-only"])
def test_flags_that_remove_the_guards_are_refused_with_the_reason(folder, flag):
    for name in ("glider.c", "controller.c", "test/plant.c", "test/fuzz.c"):
        command = f"{compiled_c.COMPILER} {STRICT} {flag} -I. -Itest -fsyntax-only"
        code, said = _compile(folder[1], f"{command} {name}")
        assert code != 0, name
        assert "guards against NaN" in said


@needs_make
@pytest.mark.parametrize("course", ["waypoints"], indirect=True)
def test_the_fastest_flags_that_keep_nan_pass_parity(folder, tmp_path):
    where = tmp_path / "fast"
    shutil.copytree(folder[1], where)
    done = _make(where, "check", "CFLAGS=-O3 -funsafe-math-optimizations")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(": pass") == 5
