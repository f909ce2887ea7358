"""Central differences along each free number, and what they say of its gradient.

How far differences can be believed follows from the rounding noise of J, estimated
from fourth differences over a few close neighbours of the point (Moré and Wild, SIAM
J. Sci. Comput. 33, 2011), and from what the next larger step says of truncation.
"""

import dataclasses
import enum
from typing import Any

import numpy as np

REALISTIC = 1e-2
"""The smallest step of a descent that matters, in the scale of a free number."""
PREDICTION = 0.5
"""Largest relative error of a predicted change that still guides a descent."""
UNSURE = 1e-2
"""Relative uncertainty of the differences from which they decide nothing."""
SATURATED = 0.95
"""Share of ticks in saturation from which it explains a vanished gradient."""
_NOTHING = 1e-10
"""Changes of J below this, relatively, are no influence."""
_NEIGHBOURS = 16


class Kind(enum.StrEnum):
    """A verdict in one word; the value is how a report says it."""

    TRUST = "trust"
    ROUGH = "exact but rough"
    NO_INFLUENCE = "no influence"
    UNDECIDED = "not decided"
    WRONG = "do not trust"


def difference_points(
    centre: np.ndarray, steps: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """Neighbours for the noise, then x + h e_i for all h and i, then x − h e_i.

    Args:
        centre: free numbers in the middle.
        steps: h of the differences, relative to the scale.
        scale: natural scale of each free number.
    """
    # Rounding errors of nearer neighbours are alike; farther ones differ in J itself.
    apart = scale * np.finfo(centre.dtype).eps ** (2.0 / 3.0)
    apart = np.maximum(apart, 16.0 * np.spacing(np.abs(centre)))
    near = centre + apart * np.arange(_NEIGHBOURS)[:, None]
    shift = (steps[:, None, None] * np.diag(scale)).reshape(-1, centre.size)
    points = np.concatenate([near, centre + shift, centre - shift])
    return np.asarray(points.astype(centre.dtype))


@dataclasses.dataclass(frozen=True)
class Probe:
    """Values around a point, in the natural scale of each free number.

    Of one free number, or of all of them in a last axis; the names are those of the
    report, and `bend` is what curvature adds to either side, (J(x+h)+J(x−h)−2J(x))/2h.
    """

    value: float
    noise: float
    gradient: Any
    steps: np.ndarray
    differences: np.ndarray
    bend: np.ndarray
    changes: np.ndarray

    @classmethod
    def of(
        cls,
        losses: np.ndarray,
        points: np.ndarray,
        steps: np.ndarray,
        scale: np.ndarray,
        gradient: np.ndarray,
    ) -> "Probe":
        """From the losses at `difference_points` and the gradient at the first."""
        shape = (steps.size, scale.size)
        near, around = np.split(losses.astype(float), [_NEIGHBOURS])
        plus, minus = np.split(around, 2)
        plus, minus = plus.reshape(shape), minus.reshape(shape)
        ahead, behind = np.split(points[_NEIGHBOURS:].astype(float), 2)
        # 2 h as it came out after rounding the points.
        span = np.sum(ahead - behind, axis=1).reshape(shape) / scale
        with np.errstate(all="ignore"):
            return cls(
                float(near[0]),
                _noise(near, np.finfo(losses.dtype).eps),
                gradient.astype(float) * scale,
                steps,
                (plus - minus) / span,
                (plus + minus - 2.0 * near[0]) / span,
                np.maximum(np.abs(plus - near[0]), np.abs(minus - near[0])),
            )

    def along(self, i: int) -> "Probe":
        """Along one free number alone."""
        return dataclasses.replace(
            self,
            gradient=float(self.gradient[i]),
            differences=self.differences[:, i],
            bend=self.bend[:, i],
            changes=self.changes[:, i],
        )

    @property
    def blur(self) -> np.ndarray:
        """Share of rounding in D(h)."""
        return np.asarray(4.0 * self.noise / self.steps)


def _noise(near: np.ndarray, unit: float) -> float:
    """Standard deviation of rounding: the fourth difference of noise is √70 times it.

    Never less than a unit in the last place of the values themselves.
    """
    floor = unit * np.max(np.abs(near))
    return float(np.maximum(np.sqrt(np.mean(np.diff(near, 4) ** 2) / 70.0), floor))


def judge(
    line: Probe, tolerance: float, saturated: float
) -> tuple[float, float, Kind, str]:
    """Error, reach, verdict and reason of one gain.

    Args:
        line: values along one gain.
        tolerance: largest relative error of a right gradient.
        saturated: share of time that its actuator is saturated.
    """
    gradient, steps = line.gradient, line.steps
    if not np.isfinite(line.value):
        return np.nan, 0.0, Kind.WRONG, "the loss is not finite here"
    if not np.isfinite(gradient):
        return np.nan, 0.0, Kind.WRONG, "the gradient is not finite"
    finite = np.isfinite(line.changes)
    if not np.any(finite):
        return np.nan, 0.0, Kind.WRONG, "the loss is not finite at any step around it"
    nothing = _NOTHING * abs(line.value) + 4.0 * line.noise
    if abs(gradient) <= nothing and bool(np.all(line.changes <= nothing)):
        why = "the loss does not depend on it here"
        if saturated >= SATURATED:
            why = f"saturated in {percent(saturated)} of all ticks"
        return 0.0, float(steps[-1]), Kind.NO_INFLUENCE, why
    # Near a minimum the slope is nearly zero: what counts is then its error against
    # the slope a realistic step away, of which it may be this small a part.
    far = int(np.flatnonzero(finite)[-1])
    rise = 1e-2 * line.changes[far] / steps[far]
    size = max(abs(gradient), rise)
    reach, exact = _reach(line), tolerance * size
    trial, doubt = _surest(line, UNSURE * size, UNSURE * rise)
    if not trial.size:
        why = "rounding or roughness hides the derivative from differences"
        return np.nan, reach, Kind.UNDECIDED, why
    error, finest = np.abs(trial - gradient), float(np.min(doubt))
    relative = float(error[np.argmin(doubt)]) / max(abs(gradient), np.finfo(float).tiny)
    near = doubt <= max(exact, 10.0 * finest)
    if not np.any(near & (error <= exact + doubt)):
        why = f"differences disagree, by {relative:.1e} relative"
        return relative, reach, Kind.WRONG, why
    kind, why = _usefulness(line, reach)
    if finest > exact:
        why = f"{why}{', ' if why else ''}checked to {finest / size:.0e} only"
    return relative, reach, kind, why


def _usefulness(line: Probe, reach: float) -> tuple[Kind, str]:
    """Whether an exact derivative is of use over realistic steps."""
    failing = ~np.isfinite(line.changes)
    if reach >= line.steps[-1]:
        return Kind.TRUST, ""
    if reach >= REALISTIC:
        return Kind.TRUST, f"up to steps of {percent(reach)}"
    if np.any(failing):
        smallest = percent(line.steps[failing][0])
        return Kind.ROUGH, f"the run fails at a step of {smallest}"
    return Kind.ROUGH, "average over scattered copies"


def _surest(
    line: Probe, decisive: float, negligible: float
) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of the derivative that the smallest meaningful step allows.

    A rough function has a second, false limit: the slope of its coarse outline, on
    which the larger steps agree. So the smallest step comes first that has a decisive
    uncertainty and does not change much to the next, and of the others only those count
    that are compatible with it. None at all do where still smaller steps contradict it
    by more than rounding.
    """
    trial, doubt = _estimates(line)
    d = line.differences
    settled = np.abs(np.diff(d)) <= 0.5 * np.abs(d[:-1]) + line.blur[:-1] + negligible
    fit = np.flatnonzero((doubt[: d.size - 1] <= decisive) & settled)
    if not fit.size:
        return trial[:0], doubt[:0]
    first = int(fit[0])
    apart = np.abs(trial - trial[first])
    smaller = np.nan_to_num(apart[:first], nan=0.0)
    if np.any(smaller > line.blur[:first] + doubt[first]):
        return trial[:0], doubt[:0]
    allowed = (doubt <= decisive) & (apart <= doubt + doubt[first])
    return trial[allowed], doubt[allowed]


def _estimates(line: Probe) -> tuple[np.ndarray, np.ndarray]:
    """D(h) and its pairs extrapolated to zero, each with its uncertainty.

    That is what rounding may add, and what the next larger step says of truncation.
    """
    d, blur = line.differences, line.blur
    square = (line.steps[1:] / line.steps[:-1]) ** 2
    pairs = (square * d[:-1] - d[1:]) / (square - 1.0)
    rounding = (square * blur[:-1] + blur[1:]) / (square - 1.0)
    # Of first order, though the order is two and four: a rough function is not smooth
    # enough over these steps for less.
    order = 2.0 / (np.sqrt(square) - 1.0)
    truncation = order * np.abs(np.diff(d))
    finer = order[:-1] * np.abs(np.diff(pairs))
    last = (np.inf,)
    trial = np.concatenate([d, pairs])
    doubt = np.concatenate([blur, rounding])
    doubt = doubt + np.concatenate([truncation, last, finer, last])
    return trial, np.where(np.isfinite(trial) & ~np.isnan(doubt), doubt, np.inf)


def _reach(line: Probe) -> float:
    """The largest step with a fair prediction at it and at all smaller ones."""
    # Curvature is no fault of the gradient: both sides differ then by as much.
    slope = np.maximum(np.abs(line.gradient), np.abs(line.bend))
    fair = np.abs(line.differences - line.gradient) <= PREDICTION * slope + line.blur
    # A step lost in the rounding of x has no difference, and is no objection.
    fair |= np.isnan(line.differences) & np.isfinite(line.changes)
    count = line.steps.size if np.all(fair) else int(np.argmin(fair))
    return float(line.steps[count - 1]) if count else 0.0


def percent(share: float) -> str:
    """A share as text."""
    return f"{100.0 * share:.3g} %"
