"""Table and figure of `bench_laws.py`, from the numbers that it kept of each law."""

from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator

from jaxglider.control.catalogue import BY_NAME
from jaxglider.plotting.style import new_figure
from tuning.reporting.statistics import clopper_pearson, paired_difference

PAPER_LAWS = ("smc", "ppc", "fxtppc")


def table(results: list[dict[str, Any]]) -> str:
    """The laws by their cost, who wins first.

    Args:
        results: what was kept of each law.
    """
    ranked = sorted(results, key=lambda r: (_failed(r), _mean_cost(r)))
    best = ranked[0]
    measures = list(best["tuned"]["measures"])
    heads = ["law", "numbers", "cost", "more than the first, 95 %"]
    heads += ["change by tuning, 95 %", *measures]
    heads += [name for name in (best["left"], "lost", "tick [ms]", "state [B]") if name]
    plain = ("law", "more than the first, 95 %", "change by tuning, 95 %")
    rule = ["---" if h in (*plain, best["left"], "lost") else "---:" for h in heads]
    lines = [
        _headline(ranked),
        "",
        f"{best['title']}, each law {best['budget']}, judged on "
        f"{len(best['tuned']['good'])} others, the same for all; start → tuned. "
        "tick: estimated for a Cortex-M4F at 100 MHz in single precision; state: what "
        "the law keeps from tick to tick, in double precision.",
        "",
        "| " + " | ".join(heads) + " |",
        "|" + "|".join(rule) + "|",
    ]
    lines += [_row(result, best) for result in ranked]
    return "\n".join(lines) + "\n"


def _row(result: dict[str, Any], best: dict[str, Any]) -> str:
    start, tuned = result["start"], result["tuned"]
    cells = [BY_NAME[result["law"]].label, str(result["numbers"])]
    cells.append(f"{_cell(_mean(start['cost'], start))} → {_cell(_mean_cost(result))}")
    cells.append("–" if result is best else _interval(_costs(best), _costs(result)))
    cells.append(_interval(_costs(result, "start"), _costs(result)))
    for name in tuned["measures"]:
        pair = [_mean(x["measures"][name], x) for x in (start, tuned)]
        cells.append(" → ".join(map(_cell, pair)))
    if best["left"]:
        cells.append(_share(tuned["left"]))
    cells.append(_share(~np.asarray(tuned["good"])))
    milliseconds = result["tick_us"] / 1e3
    cells += [f"{milliseconds:.2g}", str(result["state_bytes"])]
    return "| " + " | ".join(cells) + " |"


def _headline(ranked: list[dict[str, Any]]) -> str:
    """Who wins, and by how much over the best law of the paper; on a mission, the next.

    On a mission of yos the question is who beats the law that the glider has.
    """
    best = ranked[0]
    label = BY_NAME[best["law"]].label
    name = f"**{label} wins**"
    if _is_flown(best) and len(ranked) > 1:
        return _over(best, ranked[1], "next")
    papers = [r for r in ranked if r["law"] in PAPER_LAWS]
    others = [r for r in ranked if r["law"] not in PAPER_LAWS]
    if not papers or not others:
        return f"{name}."
    rival = others[0] if best["law"] in PAPER_LAWS else papers[0]
    whose = "other law" if best["law"] in PAPER_LAWS else "law of the paper"
    return _over(best, rival, f"best {whose}")


def _over(best: dict[str, Any], rival: dict[str, Any], whose: str) -> str:
    label = BY_NAME[best["law"]].label
    name = f"**{label} wins**"
    first, second = _costs(best), _costs(rival)
    interval = paired_difference(first, second)["interval"]
    if interval is not None and interval[0] <= 0.0:
        name = f"**{label} is first, and not told from the {whose}**"
    return (
        f"{name}: {BY_NAME[rival['law']].label} costs {_interval(first, second)} more, "
        f"{_mean_cost(rival):.3g} against {_mean_cost(best):.3g}."
    )


def _is_flown(result: dict[str, Any]) -> bool:
    return "moves [1/h]" in result["tuned"]["measures"]


def _costs(result: dict[str, Any], when: str = "tuned") -> np.ndarray:
    costs = np.asarray(result[when]["cost"])
    return np.where(np.asarray(result[when]["good"]), costs, np.inf)


def _failed(result: dict[str, Any]) -> int:
    return int(np.sum(~np.asarray(result["tuned"]["good"])))


def _mean(values: list[float | None], of: dict[str, Any]) -> float:
    good = np.asarray(of["good"])
    return float(np.asarray(values, float)[good].mean()) if good.any() else float("nan")


def _mean_cost(result: dict[str, Any]) -> float:
    return _mean(result["tuned"]["cost"], result["tuned"])


def _cell(value: float) -> str:
    """A number; "lost" where no glider was left to take it of."""
    return "lost" if np.isnan(value) else f"{value:.3g}"


def _interval(first: np.ndarray, second: np.ndarray) -> str:
    pairs = paired_difference(first, second)
    if pairs["interval"] is None:
        return "–"
    low, high = pairs["interval"]
    return f"{pairs['difference']:.2g} [{low:.2g}, {high:.2g}]"


def _share(events: Any) -> str:
    k, n = int(np.sum(events)), len(events)
    low, high = clopper_pearson(k, n)
    return f"{k}/{n} [{low:.2f}, {high:.2f}]"


def figure(results: list[dict[str, Any]]) -> Any:
    """Error of the heading against moves or the way of the mass angle, start to tuned.

    Args:
        results: what was kept of each law.
    """
    drawn = new_figure(6.4, 4.4)
    axes = drawn.add_subplot()
    flown = _is_flown(results[0])
    measures = "moves [1/h]" if flown else "angle [rad]", "heading [rad]"
    drawn_at = []
    for result in results:
        places = [
            [_mean(result[when]["measures"][m], result[when]) for m in measures]
            for when in ("start", "tuned")
        ]
        (x0, y0), (x1, y1) = places
        axes.plot([x0, x1], [y0, y1], color="0.8", linewidth=0.8, zorder=1)
        paper = result["law"] in PAPER_LAWS
        axes.plot(x1, y1, "o" if paper else "s", color="C0" if paper else "C1")
        drawn_at.append((y1, x1, BY_NAME[result["law"]].label))
    # Good laws lie close together: their names stand beside, in the order of heights.
    for number, (y, x, label) in enumerate(sorted(drawn_at)):
        axes.annotate(
            label,
            (x, y),
            xytext=(1.03, (number + 0.5) / len(drawn_at)),
            textcoords="axes fraction",
            fontsize=7,
            va="center",
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.4},
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(x=0.15, y=0.08)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    what = "moves of mass and fin [1/h]" if flown else "way of the mass angle [rad]"
    axes.set_xlabel(f"{what}, tuned; lines from the start")
    axes.set_ylabel(f"{'rms' if flown else 'L2'} of the heading error [rad]")
    return drawn
