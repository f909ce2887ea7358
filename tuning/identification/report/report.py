"""The report of a fit: plain numbers, text for a terminal, and Markdown."""

import dataclasses
from typing import Any

import numpy as np

from tuning.identification.fitting import Fit
from tuning.identification.information.least_squares import correlations
from tuning.identification.knowledge import Estimate, estimates
from tuning.identification.report.next_flights import flights_section, flights_text
from tuning.identification.verdict import CHANNEL_UNITS, Score, Verdict
from tuning.reporting.statistics import plain
from tuning.reporting.tables import markdown_table

SHOWN = {
    "depth_rate": (100.0, "cm/s"),
    "speed": (100.0, "cm/s"),
    "pitch": (180.0 / np.pi, "deg"),
    "roll": (180.0 / np.pi, "deg"),
    "turn_rate": (180.0 / np.pi, "deg/s"),
}
"""Factor and unit by which each channel is shown."""


def content_of(fit: Fit, verdict: Verdict, remarks: tuple[str, ...]) -> dict[str, Any]:
    """All results of a fit as plain numbers and sentences.

    Args:
        fit: the fit.
        verdict: verdict on it.
        remarks: warnings, in words.
    """
    known = estimates(fit)
    return {
        "vehicle": fit.vehicle.name,
        "kind": fit.plan.kind,
        "channels": list(fit.plan.channels),
        "stages": [list(stage.names) for stage in fit.plan.stages],
        "split": fit.plan.split,
        "dives": fit.flight.dives(),
        "held_out": list(fit.plan.held_out),
        "volume_m3": float(fit.after.volume),
        "parameters": [
            {
                **dataclasses.asdict(one),
                "identified": one.identified,
                "profile": one.profile and [plain(x) for x in one.profile],
            }
            for one in known
        ],
        "correlations": correlations(fit.solution.covariance).tolist(),
        "condition_number": plain(fit.solution.condition()),
        "noise": {
            name: {
                "sigma": noise.sigma,
                "correlation_samples": noise.correlation_time,
                "independent": noise.independent(),
            }
            for name, noise in fit.solution.noise.items()
        },
        "scores": {
            name: {stretch: _score(score) for stretch, score in scores.items()}
            for name, scores in verdict.scores.items()
        },
        "units": {name: CHANNEL_UNITS[name] for name in verdict.scores},
        "next_flights": [dataclasses.asdict(one) for one in fit.advice],
        "evaluations": fit.solution.evaluations,
        "converged": bool(fit.solution.converged),
        "seconds": fit.seconds,
        "remarks": list(remarks),
    }


def _score(score: Score) -> dict[str, Any]:
    return {
        "rms": plain(score.rms),
        "bias": plain(score.bias),
        "explained": plain(score.explained),
        "count": score.count,
    }


def text_of(content: dict[str, Any]) -> str:
    """The results for a terminal.

    Args:
        content: numbers and sentences from `content_of`.
    """
    held = len(content["held_out"])
    lines = [
        f"{content['vehicle']}, {content['kind']} fit of "
        f"{', '.join(content['channels'])}: {content['dives'] - held} dives, "
        f"{held} held out, {content['seconds']:.1f} s",
        f"{'':<20}{'before':>13}{'fitted':>13}{'deviation':>12}{'prior':>11}  unit",
    ]
    for one in content["parameters"]:
        mark = "" if one["identified"] else "  not identified"
        lines.append(
            f"{one['name']:<20}{one['before']:>13.6g}{one['value']:>13.6g}"
            f"{one['deviation']:>12.3g}{one['prior']:>11.3g}  {one['unit']}{mark}"
        )
    lines += ["", f"{'held-out dives':<20}{'before':>13}{'fitted':>13}{'bias':>12}"]
    lines[-1] += f"{'steady':>11}"
    for name, scores in content["scores"].items():
        factor, unit = SHOWN[name]
        cells = [
            scores["before"]["rms"],
            scores["held_out"]["rms"],
            scores["held_out"]["bias"],
            scores["held_out_steady"]["rms"],
        ]
        text = "".join(
            f"{_cell(value, factor):>{width}}"
            for value, width in zip(cells, (13, 13, 12, 11), strict=True)
        )
        lines.append(f"{f'{name} [{unit}]':<20}{text}")
    told = [*content["remarks"], *flights_text(content)]
    lines += ["", *(f"- {text}" for text in told)]
    return "\n".join(lines)


def _cell(value: float | None, factor: float) -> str:
    return "-" if value is None else f"{factor * value:.3f}"


def markdown_of(content: dict[str, Any]) -> str:
    """The report as Markdown.

    Args:
        content: numbers and sentences from `content_of`, with `record` and `files`.
    """
    held = content["held_out"]
    lines = [
        f"# {content['vehicle']} fitted to {content['record']['name']}",
        "",
        f"A {content['kind']} fit of {', '.join(content['channels'])} on "
        f"{content['dives'] - len(held)} dives; dives {_ranges(held)} were held out "
        f"and seen by nothing but the verdict. It took {content['seconds']:.1f} s, "
        "compiling included.",
        "",
        *(["## Read this first", ""] if content["remarks"] else []),
        *(f"- {text}" for text in content["remarks"]),
        "",
        "## On dives held out",
        "",
        "Root mean square of measured less predicted: all samples deeper than 5 m, "
        "turns included, and those of steady glides alone. The bias is predicted less "
        "measured.",
        "",
    ]
    rows = []
    for name, scores in content["scores"].items():
        factor, unit = SHOWN[name]
        rows.append(
            [
                f"{name} [{unit}]",
                *(
                    _cell(scores[stretch][key], factor)
                    for stretch, key in (
                        ("before", "rms"),
                        ("held_out", "rms"),
                        ("held_out_steady", "rms"),
                        ("held_out", "bias"),
                        ("train", "rms"),
                    )
                ),
                _cell(scores["held_out"]["explained"], 1.0),
            ]
        )
    head = ["channel", "before", "fitted", "steady", "bias", "fitted dives", "R²"]
    lines += markdown_table(head, rows, 1)
    lines += ["![Measured and simulated](fit.png)", ""]
    lines += ["![Errors](residuals.png)", "", "## Numbers", ""]
    lines += markdown_table(
        [
            "number",
            "unit",
            "before",
            "prior ±",
            "fitted",
            "±",
            "95 %",
            "by profile",
            "the record",
        ],
        [_row(one) for one in content["parameters"]],
        2,
    )
    lines += _rest(content)
    return "\n".join(lines) + "\n"


def _row(one: dict[str, Any]) -> list[str]:
    assumed = "" if one["stated"] else " (assumed)"
    told = f"tells {one['learned']:.0%}" if one["learned"] > 0.01 else "tells nothing"
    return [
        one["name"],
        one["unit"],
        f"{one['before']:.6g}",
        f"{one['prior']:.3g}{assumed}",
        f"{one['value']:.6g}",
        f"{one['deviation']:.2g}",
        f"{one['low']:.6g} to {one['high']:.6g}",
        " to ".join(
            "no end" if x is None else f"{x:.6g}" for x in one["profile"] or ()
        ),
        told if one["identified"] else f"**not identifiable**, {told}",
    ]


def _rest(content: dict[str, Any]) -> list[str]:
    names = [one["name"] for one in content["parameters"]]
    condition = content["condition_number"]
    told = "infinite" if condition is None else f"{condition:.3g}"
    lines = [
        "Intervals are those of the fit: noise and its correlation in time from the "
        "residuals, the prior included; `by profile` is the interval of the profile "
        "likelihood, looked for where the record tells least. `the record` is the "
        "share of the prior variance that the record took away. Numbers are searched "
        "in stages, "
        f"{'; '.join(', '.join(names) for names in content['stages'])}: each stage "
        "holds what those before it found, so its intervals are conditional on that, "
        "and correlations between stages are left out.",
        "",
        f"Condition number of the record's information: {told}. Correlations:",
        "",
    ]
    rows = [
        [name, *(f"{value:+.2f}" for value in row)]
        for name, row in zip(names, content["correlations"], strict=True)
    ]
    lines += markdown_table(["", *names], rows, 1)
    lines += flights_section(content)
    lines += ["## Noise", ""]
    lines += markdown_table(
        ["samples", "σ", "independent"],
        [
            [name, f"{n['sigma']:.3g}", f"{n['independent']:.0f}"]
            for name, n in content["noise"].items()
        ],
        1,
    )
    record = content["record"]
    lines += [
        "## Record",
        "",
        f"{record['name']}, {record['kind']}, SHA-256 `{record['sha256']}`; volume "
        f"{1e3 * content['volume_m3']:.3f} L.",
        "",
        *(f"- {f['channel']}: {f['text']}" for f in record["findings"]),
    ]
    return lines


def _ranges(numbers: list[int]) -> str:
    """Numbers as text: 10 to 18, or 2, 4, 6."""
    if len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]} to {numbers[-1]}"
    return ", ".join(str(number) for number in numbers)


def estimate_named(known: tuple[Estimate, ...], name: str) -> Estimate:
    """The estimate of one number.

    Args:
        known: all estimates.
        name: name of the number.

    Raises:
        KeyError: it was not fitted.
    """
    for one in known:
        if one.name == name:
            return one
    raise KeyError(f"{name} was not fitted; {', '.join(e.name for e in known)} were.")
