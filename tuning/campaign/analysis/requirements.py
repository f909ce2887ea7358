"""Requirements on a campaign, as `p_violation<0.01`; nothing here imports JAX.

`spec<0.05`, or `spec` alone for that, asks how likely a member breaks any part of the
specification: a funnel, the bank limit, the saturated share. Its interval and those of
the parts hold at once, by Bonferroni's correction.

A requirement is met where the whole confidence interval is on the right side. Where
only the estimate is, the members are too few to say so, and that does not count as met.
"""

import argparse
import dataclasses
import math
import operator
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuning.campaign.analysis.summary import ControllerSummary


PROBABILITIES = (
    "p_violation",
    "p_violation_depth",
    "p_violation_pitch",
    "p_violation_heading",
    "p_capsize",
    "p_unfinished",
    "p_failure",
)
ENDS = {
    "p_bottom": "bottom",
    "p_hover": "hover",
    "p_stall": "stall",
    "p_battery_empty": "battery empty",
}
"""Early ends of a mission, by the names of their probabilities."""
SPECIFICATION = "spec"
"""The whole specification, as a quantity: the probability of breaking any part."""
_DEFAULT_SHARE = 0.05
STATISTICS = ("mean", "q05", "q50", "q95", "q99", "cvar95", "worst")
_OPERATORS = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_FORM = re.compile(r"^(?:(.+):)?\s*([\w.]+)\s*(<=|>=|<|>)\s*(\S+)\s*$")


@dataclasses.dataclass(frozen=True)
class Requirement:
    """One inequality.

    Attributes:
        text: text of the requirement as the user wrote it.
        label: label of the set of gains it is asked of; empty for all.
        quantity: a probability, or a measure with a statistic.
        comparison: the sign.
        limit: the number.
    """

    text: str
    label: str
    quantity: str
    comparison: str
    limit: float

    def check(self, labels: Sequence[str], measures: Sequence[str]) -> None:
        """Refuse what no campaign of these could say.

        Args:
            labels: labels of the sets of gains.
            measures: names of the measures that are summarised.

        Raises:
            ValueError: there is no such set of gains or measure.
        """
        if self.label and self.label not in labels:
            raise ValueError(
                f"--require {self.text}: no gains are called {self.label!r}; there "
                f"are {', '.join(labels)}."
            )
        measure = self.quantity.rpartition(".")[0]
        flights = any(name.startswith("flight.") for name in measures)
        if self.quantity == SPECIFICATION or (flights and self.quantity in ENDS):
            return
        if self.quantity in ENDS:
            raise ValueError(
                f"--require {self.text}: no yos are flown that could end early; "
                f"choose from {', '.join(PROBABILITIES)}."
            )
        if self.quantity not in PROBABILITIES and measure not in measures:
            raise ValueError(
                f"--require {self.text}: there is no measure {measure!r}; choose from "
                f"{', '.join(measures)}."
            )

    def judged(
        self, controllers: "dict[str, ControllerSummary]"
    ) -> list[dict[str, Any]]:
        """The verdict for each set of gains it is asked of.

        Args:
            controllers: part of the summary about each controller.
        """
        chosen = [self.label] if self.label else list(controllers)
        return [self._judge(label, controllers[label]) for label in chosen]

    def _judge(self, label: str, summary: "ControllerSummary") -> dict[str, Any]:
        estimate, interval = self._look_up(summary)
        holds = _OPERATORS[self.comparison]
        less = self.comparison.startswith("<")
        end = interval[1 if less else 0] if interval else estimate
        if estimate is None or not holds(estimate, self.limit):
            verdict = "violated"
        elif end is None or not holds(end, self.limit):
            verdict = "not shown"
        else:
            verdict = "met"
        entry = {
            "requirement": self.text,
            "controller": label,
            "estimate": estimate,
            "interval": interval,
            "verdict": verdict,
        }
        if self.quantity == SPECIFICATION:
            entry["correction"] = f"Bonferroni, {len(summary.broken)} intervals"
            entry["parts"], entry["limit"] = summary.broken, self.limit
        return entry

    def _look_up(self, summary: "ControllerSummary") -> tuple[float | None, Any]:
        if self.quantity == SPECIFICATION:
            entry = summary.broken["any"]
            return entry["p"], entry["simultaneous"]
        if self.quantity in (*PROBABILITIES, *ENDS):
            entry = summary.probabilities[self.quantity]
            return entry["p"], entry["interval"]
        measure, _, statistic = self.quantity.rpartition(".")
        entry = summary.measures[measure][statistic]
        if isinstance(entry, dict):
            return entry["value"], entry["interval"]
        return entry, None


def requirement(text: str) -> Requirement:
    """A requirement from the command line.

    Raises:
        argparse.ArgumentTypeError: it cannot be read.
    """
    whole = text.strip().endswith(SPECIFICATION)
    form = _FORM.match(f"{text}<{_DEFAULT_SHARE}" if whole else text)
    limit = None
    if form:
        try:
            limit = float(form[4])
        except ValueError:
            limit = None
    if form is None or limit is None or not math.isfinite(limit):
        raise argparse.ArgumentTypeError(
            "must be [LABEL:]QUANTITY<NUMBER (or <=, >, >=), as p_violation<0.01, with "
            f"a finite number; received {text!r}."
        )
    quantity = form[2]
    of_probability = quantity in (*PROBABILITIES, *ENDS, SPECIFICATION)
    if of_probability and not 0.0 <= limit <= 1.0:
        raise argparse.ArgumentTypeError(
            f"a probability is compared with a number in [0, 1]; received {text!r}."
        )
    known = of_probability or quantity.rpartition(".")[2] in STATISTICS
    if not known:
        raise argparse.ArgumentTypeError(
            f"{quantity!r} is no quantity: give {SPECIFICATION}, one of "
            f"{', '.join((*PROBABILITIES, *ENDS))}, or a measure with a statistic, as "
            f"heading.rms_error.q95 (statistics: {', '.join(STATISTICS)})."
        )
    return Requirement(
        text=text,
        label=form[1] or "",
        quantity=quantity,
        comparison=form[3],
        limit=limit,
    )
