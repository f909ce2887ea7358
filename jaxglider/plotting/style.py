"""Look of the figures: colours, line styles and sizes, all handed over explicitly.

Colours are those of Okabe and Ito, told apart with every kind of colour vision; line
styles differ too, so that a print in grey still reads.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.transforms import offset_copy

from jaxglider.control.catalogue import LAWS

INK = "#222222"
"""Reference, truth, waypoints."""
SHADE = "#d9d9d9"
"""Funnels."""
FAINT = "#8c8c8c"
"""Colour of samples in a legend that stand for lines of all colours."""
COLUMN = 3.5
"""Width of one journal column [in]."""
PAGE = 7.16
"""Width of two journal columns [in]."""
HALF_HOUR = 1800.0
"""Length beyond which a run is told in hours [s]."""
_HANDLE, _PAD, _SPACING = 2.2, 0.5, 1.1
"""Spaces of a legend in font sizes: length of a line, gap to its label, gap to the
next."""

_RC: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.unicode_minus": True,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.linewidth": 0.4,
    "grid.color": "#e6e6e6",
    "lines.linewidth": 1.1,
    "lines.dash_capstyle": "butt",
    "figure.dpi": 100.0,
    "savefig.dpi": 300.0,
    "savefig.bbox": None,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}


class Style(NamedTuple):
    """Style of one run's lines.

    Attributes:
        colour: colour of its lines.
        dashes: line style of Matplotlib.
    """

    colour: str
    dashes: Any


_BLUE = Style("#0072B2", "-")
_WINE = Style("#882255", (0, (1, 1)))
_VERMILION = Style("#D55E00", (0, (5, 1.2)))
_GREEN = Style("#009E73", (0, (5, 1.2, 1.2, 1.2)))
_OTHERS = (
    Style("#CC79A7", (0, (2, 1))),
    Style("#E69F00", (0, (8, 1.5))),
    Style("#56B4E9", (0, (3, 1, 1, 1, 1, 1))),
    Style("#000000", (0, (1, 1))),
)
# The laws of the catalogue in its order; one more takes the first of the others.
_OWN = dict(
    zip(
        (entry.label.lower() for entry in LAWS),
        (_GREEN, _VERMILION, _BLUE, _WINE, *_OTHERS),
        strict=False,
    )
)


def styles(labels: Iterable[str]) -> dict[str, Style]:
    """A style for each label; those of jaxglider's own controllers are always the same.

    Args:
        labels: names of the runs; the others take the remaining styles in their order.
    """
    labels = list(labels)
    chosen: dict[str, Style] = {}
    others = 0
    for label in labels:
        own = _OWN.get(label.strip().lower())
        if own is None:
            own = _OTHERS[others % len(_OTHERS)]
            others += 1
        # A run by itself has no other to be told from by its dashes.
        chosen[label] = own if len(labels) > 1 else own._replace(dashes="-")
    return chosen


@contextmanager
def look() -> Iterator[None]:
    """The drawing defaults of this package, in force within a `with` block only.

    They do not depend on the user's matplotlibrc, which may ask for a LaTeX that is not
    there, or for a font that has no Greek letters.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure that needs no display and belongs to no global state.

    Args:
        width: width of the figure [in].
        height: height of the figure [in].
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def flat(axes: Any, number: int, owner: str) -> list[Axes]:
    """The axes in reading order.

    Args:
        axes: axes in an array or sequence of any shape.
        number: number of axes needed.
        owner: name of the figure, for the message.

    Raises:
        ValueError: their number is wrong.
    """
    panels = list(np.ravel(np.asarray(axes, dtype=object)))
    if len(panels) != number:
        raise ValueError(
            f"{owner} needs {number} axes; received {len(panels)}. Make them with "
            "figure.subplots."
        )
    return panels


def time_unit(end: float, short: float = 1.0) -> tuple[float, str]:
    """Unit of a time axis [s] and its label: hours for long runs.

    Args:
        end: end of the longest run [s].
        short: unit for short runs [s], a second or a minute.
    """
    if end > HALF_HOUR:
        return 3600.0, "time (h)"
    return short, "time (s)" if short == 1.0 else "time (min)"


def label_time(axes: Sequence[Axes], end: float) -> None:
    """One time scale for all; named on the lowest row, in hours for long runs.

    Args:
        axes: axes over a time in seconds.
        end: end of the time axis [s].
    """
    unit, label = time_unit(end)
    for axis in axes:
        place = axis.get_subplotspec()
        if place is None or place.is_last_row():
            axis.set_xlabel(label)
        if end > 0.0:
            axis.set_xlim(0.0, end)
        if unit != 1.0:
            axis.xaxis.set_major_locator(_TicksOf(unit))
            axis.xaxis.set_major_formatter(FuncFormatter(lambda t, _: f"{t / unit:g}"))


class _TicksOf(MaxNLocator):
    """Round numbers of a unit, on an axis of seconds."""

    def __init__(self, unit: float) -> None:
        super().__init__(nbins="auto", steps=[1, 2, 2.5, 5, 10])
        self._unit = unit

    def tick_values(self, vmin: float, vmax: float) -> Any:
        ticks = super().tick_values(vmin / self._unit, vmax / self._unit)
        return self._unit * np.asarray(ticks)


_USUAL_ROWS = 5


def legend_above(
    axis: Axes, handles: Sequence[Any], beside: Sequence[Axes] = ()
) -> None:
    """A legend outside the frame, above it, in as many columns as there is room for.

    A figure with a legend of more rows than a few runs have grows by them.

    Args:
        axis: the legend ends at its right edge and may spread to the left of it.
        handles: handles with labels, in reading order.
        beside: other axes of the row; the legend rises above the notes on these too.
    """
    size = FontProperties(size=matplotlib.rcParams["legend.fontsize"])
    columns = _columns_that_fit(axis, [h.get_label() for h in handles], size)
    noted = any(a.get_title(loc="right") for a in (axis, *beside))
    figure: Any = axis.figure
    beyond = max(-(-len(handles) // columns) - _USUAL_ROWS, 0)
    sheet: Any = axis.get_figure(root=True)
    line = 1.5 * size.get_size_in_points() / 72.0
    sheet.set_figheight(sheet.get_figheight() + beyond * line)
    place: dict[str, Any] = {
        "loc": "lower right",
        "bbox_to_anchor": (1.0, 1.0),
        "bbox_transform": offset_copy(
            axis.transAxes, figure, 0.0, 17.0 if noted else 5.0, units="points"
        ),
    }
    axis.legend(
        handles=[h for start in range(columns) for h in handles[start::columns]],
        ncols=columns,
        prop=size,
        frameon=False,
        borderpad=0.0,
        borderaxespad=0.0,
        handlelength=_HANDLE,
        handletextpad=_PAD,
        columnspacing=_SPACING,
        **place,
    )


def _columns_that_fit(axis: Axes, labels: list[str], size: FontProperties) -> int:
    """The legend columns that fill the fewest rows without widening the figure."""
    figure, place = axis.figure, axis.get_subplotspec()
    beside = 1 if place is None else place.get_gridspec().ncols
    room = 0.95 * figure.bbox.width / figure.dpi * 72.0 / beside
    em = size.get_size_in_points()
    widths = [
        text_to_path.get_text_width_height_descent(label, size, ismath=False)[0]
        for label in labels
    ]
    number = len(labels)
    for columns in (-(-number // rows) for rows in range(1, number)):
        text = sum(max(widths[start::columns]) for start in range(columns))
        gaps = columns * (_HANDLE + _PAD) + (columns - 1) * _SPACING
        if text + gaps * em <= room:
            return columns
    return 1


def off_scale(axis: Axes, low: float, high: float, what: str) -> None:
    """Show a part of the range only, and say above the frame what is not shown.

    Args:
        axis: axes whose vertical range is set.
        low: end of the range.
        high: other end.
        what: name of the lines that are cut off.
    """
    axis.set_ylim(low, high)
    axis.set_title(what, loc="right", pad=3.0)


def in_words(number: float) -> str:
    """A number of two or three digits for a note in a figure."""
    digits = 3 if abs(number) >= 100.0 else 2
    return f"{float(f'{number:.{digits}g}'):g}".replace("-", "−")


def distinct_styles(number: int) -> list[Style]:
    """Styles for lines that are no runs, told apart from each other."""
    every = (_BLUE, _WINE, _VERMILION, _GREEN, *_OTHERS)
    return [every[k % len(every)] for k in range(number)]
