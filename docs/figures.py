"""The sheet of all figures: `python docs/figures.py` draws it.

Of what was recorded once, `python docs/figures.py --record`: the paper's course with
two laws, yos of a shallow Slocum and of one on its sensors, a flight that fails; and
what tune, sweep, trim, fit and record found. A test draws the sheet again and compares
it with images/figures.png: nobody has to fly for it.
"""

import argparse
import dataclasses
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path

import jax
import numpy as np
from command_figures import command_figures, record_commands
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from recording import keep, kept

import jaxglider
from jaxglider import paper
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import build_mission, load_mission
from jaxglider.files.user_law import label_of
from jaxglider.plotting import figures
from jaxglider.plotting.flight import dive_pages
from jaxglider.plotting.style import look
from jaxglider.simulation.checks.past import before, first_nonsense
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory
from tuning.reporting.tables import headline

HERE = Path(__file__).parent
RECORDED, SHEET = HERE / "recorded", HERE / "images" / "figures.png"
SIDE, COLUMNS = 330, 5
"""Side of a cell of the sheet [pixels], and number of cells in a row."""


_MISSIONS = ("slocum-shallow", "slocum-on-board")
_SENSED = ("reckoning", "estimates")
"""How names of figures begin that only a flight on sensors has."""
_TURNING = {
    "start_s": [0.0, 10.0],
    "gliding_angle_deg": [-30.0, -30.0],
    "heading_deg": [170.0, -170.0],
    "depth_rate_m_s": [0.2, 0.2],
}


@functools.cache
def flights() -> dict[str, tuple[str, int, dict[str, ClosedLoop]]]:
    """Title, ticks from one record to the next, and closed loops of each flight."""
    laws = ("smc", "fxtppc")
    course = {law: paper.make_loop("waypoints", "rigid-body", law) for law in laws}
    yos, sensors = (load_mission(mission_path(name)) for name in _MISSIONS)
    dead = build_mission(
        {
            "vehicle": {"data": "slocum", "plant": "rigid-body"},
            "clock": {"dt_s": 5.0, "duration_s": 300.0},
            "reference": {"schedule": _TURNING},
        }
    )
    return {
        "course": (headline("waypoints", "SeaWing", "rigid-body"), 50, course),
        "yos": (
            headline(yos.name, yos.vehicle, yos.plant),
            5,
            {yos.controller: yos.loop},
        ),
        "sensors": (
            headline(sensors.name, sensors.vehicle, sensors.plant),
            5,
            {sensors.controller: sensors.loop},
        ),
        "failed": (
            headline("tick of 5 s", dead.vehicle, dead.plant),
            1,
            {dead.controller: dead.loop},
        ),
    }


def record() -> None:
    """Fly all, and keep what figures are drawn of, in single precision."""
    RECORDED.mkdir(exist_ok=True)
    for name, (_, every, flown) in flights().items():
        for law, loop in flown.items():
            setting, key = loop.scenario, jax.random.key(0)
            given = loop, setting.sea(key), setting.noise(key)
            run = jax.device_get(jax.jit(jaxglider.simulate)(*given))
            culprit = first_nonsense(run, 0.0)
            if culprit is not None:
                run = before(run, culprit.tick)
            keep(RECORDED / f"{name}-{law}.npz", thinned(run, every))


def thinned(run: Trajectory, every: int) -> Trajectory:
    """One record in so many, and all that have a fix."""
    kept_rows = np.arange(len(run.ticks.time)) % every == 0
    if run.ticks.onboard is not None:
        kept_rows |= np.isfinite(np.asarray(run.ticks.onboard.fix[0]))
    ticks = jax.tree.map(lambda x: np.asarray(x)[kept_rows], run.ticks)
    return dataclasses.replace(run, ticks=ticks)


def recorded(name: str, law: str) -> Trajectory:
    """A flight as it was recorded; its metrics are empty."""
    return kept(RECORDED / f"{name}-{law}.npz")


def cells() -> Iterator[tuple[str, np.ndarray]]:
    """Name and picture of every figure, each in a cell of the sheet."""
    for flight, (title, _, flown) in flights().items():
        runs = {label_of(law): recorded(flight, law) for law in flown}
        scenario = next(iter(flown.values())).scenario
        for name, figure in figures(scenario, runs, title=title):
            if _shown(flight, name):
                yield f"{flight}/{name}", _cell(figure)
        if flight == "yos":
            ((law, run),) = runs.items()
            with look():
                _, page, *_ = dive_pages(run, scenario.actuators, f"{title}, {law}")
                yield "yos/dive", _cell(page)
    for name, figure in command_figures():
        yield name, _cell(figure)


def _shown(flight: str, name: str) -> bool:
    """Whether the sheet has a figure of a flight: it would not be the second such."""
    if flight == "sensors":
        return name.startswith(_SENSED)
    return flight == "course" or not name.startswith("performance")


def _cell(figure: Figure) -> np.ndarray:
    """A figure in the middle of a white cell, as large as fits."""
    figure.set_dpi(0.98 * SIDE / max(figure.get_size_inches()))
    canvas = FigureCanvasAgg(figure)
    with look():
        canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[:, :, :3]
    cell = np.full((SIDE, SIDE, 3), 255, np.uint8)
    height, width = picture.shape[:2]
    top, left = (SIDE - height) // 2, (SIDE - width) // 2
    cell[top : top + height, left : left + width] = picture
    return cell


def sheet(drawn: Mapping[str, np.ndarray]) -> np.ndarray:
    """All cells in rows, the last one filled up with white."""
    pictures = list(drawn.values())
    pictures += [np.full_like(pictures[0], 255)] * (-len(pictures) % COLUMNS)
    starts = range(0, len(pictures), COLUMNS)
    rows = [np.concatenate(pictures[n : n + COLUMNS], axis=1) for n in starts]
    return np.concatenate(rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--record", action="store_true")
    if parser.parse_args().record:
        jax.config.update("jax_enable_x64", True)
        record()
        record_commands()
    from PIL import Image

    picture = Image.fromarray(sheet(dict(cells())))
    picture.quantize(64).save(SHEET, optimize=True)
