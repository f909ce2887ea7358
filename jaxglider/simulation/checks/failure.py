"""Failure of a run: when, which number, in what state, and why most likely."""

import dataclasses
import math
from typing import Any

from jaxglider.signals import COMMAND_UNITS
from jaxglider.simulation.checks.causes import OF_THE_TASK, RULES
from jaxglider.simulation.checks.past import Culprit, Past, before, first_nonsense
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory


@dataclasses.dataclass(frozen=True)
class Failure:
    """Explanation of a failed run.

    Attributes:
        culprit: first number that made no sense.
        state: state just before [m, rad, m/s, rad/s], by name.
        command: command held then [kg, m, rad], by name.
        causes: sentences on likely causes, the likeliest first; empty where no rule
            has anything to say.
        of_the_task: whether the likeliest is none that other gains could mend.
    """

    culprit: Culprit
    state: dict[str, float]
    command: dict[str, float]
    causes: tuple[str, ...]
    of_the_task: bool = False

    def cause(self) -> str:
        """The likeliest cause, or what is to be looked at where none is known."""
        if self.causes:
            return self.causes[0]
        return (
            "no rule knows why: look at the files, which end there, and try a shorter "
            "tick (clock.dt_s)"
        )

    def lines(self) -> list[str]:
        """The explanation: the cause first, then what was seen."""
        at = self.culprit
        s, degrees = self.state, {k: math.degrees(v) for k, v in self.state.items()}
        speed = math.hypot(s["surge"], s["sway"], s["heave"])
        held = ", ".join(
            f"{name.replace('_', ' ')} {value:.4g} {COMMAND_UNITS[name]}"
            for name, value in self.command.items()
        )
        return [
            f"failed at {at.time:.6g} s: {self.cause()}.",
            f"{at.name.replace('_', ' ')} was {at.value:.3g} there. Just before: depth "
            f"{s['depth']:.4g} m, {speed:.3g} m/s, roll {degrees['roll']:.0f} deg, "
            f"pitch {degrees['pitch']:.0f} deg, heading {degrees['heading']:.0f} deg; "
            f"{held}.",
            *(f"also: {text}." for text in self.causes[1:]),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and sentences, as they stand in JSON."""
        value = self.culprit.value
        return {
            "time_s": self.culprit.time,
            "quantity": self.culprit.name,
            "value": value if math.isfinite(value) else None,
            "state": self.state,
            "command": self.command,
            "causes": list(self.causes),
        }


def explain(loop: ClosedLoop, run: Trajectory) -> Failure | None:
    """The explanation of a failed run; None of one that makes sense to its end.

    Args:
        loop: closed loop that was flown.
        run: trajectory on the host, every tick recorded.
    """
    clock = loop.scenario.clock
    culprit = first_nonsense(run, clock.ticks * float(clock.dt))
    if culprit is None:
        return None
    past = Past(loop, culprit, before(run, culprit.tick).ticks)
    said = [(rule, text) for rule in RULES if (text := rule(past)) is not None]
    return Failure(
        culprit=culprit,
        state={name: float(x) for name, x in vars(past.last_state()).items()},
        command={name: float(x) for name, x in vars(past.last_command()).items()},
        causes=tuple(text for _, text in said),
        of_the_task=bool(said) and said[0][0] in OF_THE_TASK,
    )
