"""The picture of the front page: `python docs/course.py` writes images/course.png.

The paper's waypoint course on the `rigid-body` plant, flown by FxTPPC with the
gains that come along; its errors are drawn in the paper's funnels.
"""

import argparse
from pathlib import Path

import jax
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import jaxglider
from jaxglider import ClosedLoop, paper
from jaxglider.files.gains import load_gains
from jaxglider.guidance import WaypointPath
from jaxglider.paper.tuned import tuned_gains
from jaxglider.plotting import errors, path_plan
from jaxglider.plotting.save import save
from jaxglider.plotting.style import (
    PAGE,
    SHADE,
    legend_above,
    look,
    new_figure,
    styles,
)

CASE, PLANT, LAW = "waypoints", "rigid-body", "fxtppc"


def tuned_loop() -> ClosedLoop:
    """The course with the gains that come along, judged by what the paper specifies."""
    scenario = paper.make_scenario(CASE, PLANT)
    model = paper.design_model(scenario.plant)
    return load_gains(tuned_gains(CASE, PLANT, LAW), CASE, model).on(scenario)


def draw(path: Path) -> None:
    """The way from above on the left, the three errors on the right."""
    loop = tuned_loop()
    sea = loop.scenario.sea(jax.random.key(0))
    name = "FxTPPC"
    runs = {name: jax.device_get(jax.jit(jaxglider.simulate)(loop, sea))}
    course = loop.scenario.reference
    assert isinstance(course, WaypointPath)
    with look():
        figure = new_figure(PAGE, 3.6)
        left, right = figure.subfigures(1, 2, width_ratios=[0.85, 1.0])
        plan, panels = left.subplots(), right.subplots(3, 1, sharex=True)
        path_plan(plan, runs, course)
        errors(panels, runs)
        right.align_ylabels()
        colour = styles(runs)[name].colour
        line = Line2D([], [], color=colour, label="error")
        legend_above(panels[0], [line, Patch(color=SHADE, label="funnel")])
        # One run alone needs no dashes to be told apart.
        for axis in (plan, *panels):
            legend = axis.get_legend()
            for drawn in (*axis.lines, *(legend.get_lines() if legend else ())):
                if drawn.get_color() == colour and drawn.get_linestyle() != "None":
                    drawn.set(linestyle="-", linewidth=1.3)
        save(figure, path)


def main() -> None:
    """Fly and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    target = Path(__file__).parent / "images" / "course.png"
    parser.add_argument("--out", type=Path, default=target)
    options = parser.parse_args()
    jaxglider.enable_fast_loops()
    jax.config.update("jax_enable_x64", True)
    draw(options.out)


if __name__ == "__main__":
    main()
