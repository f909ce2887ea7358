"""Figure of a steady motion: glide polar, eigenvalues, and what reaches which mode."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxglider.plotting.style import (
    FAINT,
    INK,
    PAGE,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from jaxglider.trim.modes import Analysis
from jaxglider.trim.steady_motion import SteadyMotion
from jaxglider.trim.straight_glide import glide_polars
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant

_INPUTS = (r"$m_b$", r"$r_{p1}$", r"$\gamma$")


def polar(
    axis: Axes,
    plant: AbstractPlant,
    buoyancy: Sequence[float],
    motion: SteadyMotion | None = None,
) -> Axes:
    """Depth rate against horizontal speed of all straight glides.

    Args:
        axis: axes to draw on.
        plant: the glider.
        buoyancy: masses [kg], one line for dives and one for climbs with each.
        motion: steady motion, marked by a dot.
    """
    alpha = np.radians(np.geomspace(0.02, 20.0, 200))
    for mass, style in zip(buoyancy, distinct_styles(len(buoyancy)), strict=True):
        for sense in (1.0, -1.0):
            angle, speed = map(
                np.asarray,
                glide_polars(plant, sense * mass, jnp.asarray(sense * alpha)),
            )
            axis.plot(
                speed * np.cos(angle),
                -speed * np.sin(angle),
                color=style.colour,
                ls=style.dashes,
                label=f"{mass:g} kg" if sense > 0.0 else None,
            )
    if motion is not None:
        axis.plot(
            float(motion.horizontal_speed()),
            float(motion.sink_rate()),
            "o",
            color=INK,
            ms=4,
            zorder=5,
        )
    axis.axhline(0.0, color=INK, lw=0.5)
    axis.set_xlim(left=0.0)
    axis.invert_yaxis()
    axis.set_xlabel("horizontal speed (m/s)")
    axis.set_ylabel("depth rate (m/s)")
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return axis


def eigenvalues(axis: Axes, analysis: Analysis) -> Axes:
    """The modes in the complex plane, filled as far as they are lateral."""
    for mode in analysis.modes:
        value = mode.eigenvalue
        lateral = mode.lateral > 0.5
        for imaginary in {value.imag, -value.imag}:
            axis.plot(
                value.real,
                imaginary,
                "s" if lateral else "o",
                color=distinct_styles(2)[int(lateral)].colour,
                ms=5,
                mfc="none" if lateral else None,
            )
    for label, marker, n in (("longitudinal", "o", 0), ("lateral", "s", 1)):
        axis.plot(
            [],
            [],
            marker,
            ms=5,
            color=distinct_styles(2)[n].colour,
            mfc="none" if n else None,
            label=label,
        )
    axis.axvline(0.0, color=INK, lw=0.5)
    axis.set_xlabel("growth (1/s)")
    axis.set_ylabel("frequency (rad/s)")
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return axis


def reach(axis: Axes, analysis: Analysis) -> Axes:
    """Speed at which the full stroke of each actuator sets each mode off, as shades."""
    table = np.array([mode.reach for mode in analysis.modes])
    shade = np.log10(np.maximum(table, 1e-3))
    axis.imshow(shade, cmap="Blues", vmin=-3.0, vmax=1.5, aspect="auto")
    for row, column in np.ndindex(*table.shape):
        value = table[row, column]
        text = "0" if value < 1e-6 else f"{value:.2g}"
        dark = shade[row, column] > -0.2
        axis.text(
            column, row, text, ha="center", va="center", color="w" if dark else INK
        )
    names = []
    for mode in analysis.modes:
        at = mode.eigenvalue
        turning = f" ± {at.imag:.2f}i" if at.imag else ""
        names.append(f"{at.real:.2f}{turning}".replace("-", "−"))
    axis.set_yticks(range(len(names)), names)
    axis.set_xticks(range(3), _INPUTS)
    axis.tick_params(length=0.0)
    axis.grid(visible=False)
    axis.set_title("reach of full strokes (1/s)", color=FAINT)
    return axis


def glide_figure(
    vehicle: VehicleData,
    plant: AbstractPlant,
    motion: SteadyMotion,
    analysis: Analysis,
    name: str,
) -> Figure:
    """The figure of a steady motion.

    Args:
        vehicle: vehicle whose limits scale the polar.
        plant: the glider.
        motion: the steady motion.
        analysis: analysis of its linearisation.
        name: name of the plant.
    """
    limit = float(vehicle.limits.buoyancy_mass)
    with look():
        figure = new_figure(PAGE, 3.0)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.2, 1.0, 0.8))
        polar(left, plant, [limit / 4, limit / 2, limit], motion)
        eigenvalues(middle, analysis)
        reach(right, analysis)
        figure.suptitle(f"trim: {vehicle.name} ({name})", wrap=True)
    return figure
