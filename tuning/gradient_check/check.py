"""Is the gradient to be trusted? Reverse mode against differences, gain by gain.

Two questions, apart. Is the derivative exact? Then it agrees with central differences
at small steps, D(h) = (J(x+h) − J(x−h))/2h, or with a pair of them extrapolated to
zero, (r² D(h) − D(rh))/(r² − 1). Is it of use? Then it also predicts the change of J
over the steps that a descent takes, 1 % to 10 % of a gain. On long runs the first can
hold without the second.

How far differences can be believed follows from the rounding noise of J, estimated
from fourth differences over a few close neighbours of the point (Moré and Wild, SIAM
J. Sci. Comput. 33, 2011), and from what the next larger step says of truncation. Use
double precision: in single precision rounding hides all but coarse errors, and the
verdict says how coarse.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.batching import map_members
from jaxglider.core.kept.programs import kept
from jaxglider.signals import CHANNELS
from jaxglider.simulation.metrics import Metrics
from tuning.gradient_check.probe import REALISTIC, Kind, Probe, difference_points, judge

Loss = Callable[[Any], Any]
STEPS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
SHORT_STEPS = (1e-8, 1e-7, 1e-2, 1e-1)
"""Enough for a glance before a descent, with less than half the rollouts."""
_CHANNEL_OF = {
    "buoyancy_mass": "depth",
    "mass_position": "pitch",
    "mass_angle": "heading",
}


@dataclasses.dataclass(frozen=True)
class GradientReport:
    """Result of a check. Arrays run over the gains last; k steps, m copies.

    Attributes:
        names: names of the gains.
        free: the free numbers x at which the gradient was checked.
        scale: natural scale of each free number.
        value: J(x).
        noise: standard deviation of the rounding noise of J.
        gradient: reverse mode, per unit of each free number.
        steps: h, in the scale of each free number, rising.
        differences: D(h), k rows.
        changes: larger one of |J(x+h) − J(x)| and |J(x−h) − J(x)|, k rows.
        error: |D − gradient| / |gradient| at the surest difference.
        reach: largest step up to which the gradient predicts the change of J.
        copies: gradients at copies of x scattered around it, m rows.
        saturated: share of ticks in saturation of the gain's channel; NaN if not given.
        kinds: verdict of each gain in a word.
        verdicts: verdicts of the comparisons, each a sentence.
    """

    names: tuple[str, ...]
    free: np.ndarray
    scale: np.ndarray
    value: float
    noise: float
    gradient: np.ndarray
    steps: np.ndarray
    differences: np.ndarray
    changes: np.ndarray
    error: np.ndarray
    reach: np.ndarray
    copies: np.ndarray
    saturated: np.ndarray
    kinds: tuple[Kind, ...]
    verdicts: tuple[str, ...]

    @property
    def kind(self) -> Kind:
        """The worst verdict among the gains that have any influence."""
        order = (Kind.WRONG, Kind.UNDECIDED, Kind.ROUGH, Kind.TRUST, Kind.NO_INFLUENCE)
        return next(kind for kind in order if kind in self.kinds)

    @property
    def verdict(self) -> str:
        """The verdict on the whole gradient in a sentence."""
        count = f"{self.kinds.count(self.kind)} of {len(self.kinds)} gains"
        text = self.verdicts[self.kinds.index(self.kind)]
        silent = self.kinds.count(Kind.NO_INFLUENCE)
        if silent and self.kind is not Kind.NO_INFLUENCE:
            count += f"; without influence: {silent}"
        return f"{text} ({count})"

    @property
    def prediction(self) -> np.ndarray:
        """True over predicted change of J at each step; 1 is perfect."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.differences / self.gradient)

    @property
    def norms(self) -> np.ndarray:
        """Gradient norm here, then at the copies, in the scale of the free numbers."""
        every = np.concatenate([self.gradient[None], self.copies])
        return np.asarray(np.linalg.norm(every * self.scale, axis=1))


def check_gradient(
    loss: Loss,
    free: Any,
    names: Sequence[str],
    *,
    steps: Sequence[float] = STEPS,
    relative_tolerance: float = 1e-5,
    scale: Any = 1.0,
    saturated: Mapping[str, float] | None = None,
    copies: int = 8,
    spread: float = 0.05,
    block: int = 64,
) -> GradientReport:
    """Compare reverse mode with central differences for each free number.

    Two programs are compiled, whatever the number of gains and steps.

    Args:
        loss: J of the free numbers; pure.
        free: the free numbers.
        names: names of the gains; a channel or actuator in its dotted path relates it
            to `saturated`, and a gain without one counts as free of saturation as the
            freest channel.
        steps: relative steps, in `scale`.
        relative_tolerance: largest relative error of an exact derivative.
        scale: natural scale of a free number, one or one for each; 1 suits logarithms,
            where a step of 0.01 is one percent of the gain.
        saturated: share of ticks in saturation by channel; see `saturation`.
        copies: number of scattered copies to take the gradient at as well.
        spread: standard deviation of the copies, in `scale`.
        block: points per block of the batched loss; lower it where one loss is already
            an ensemble.

    Raises:
        ValueError: lengths differ, or steps or tolerance are out of range.
    """
    free, sizes = jnp.asarray(free), np.unique(np.asarray(steps, dtype=float))
    _check(free, names, sizes, relative_tolerance)
    centre = np.asarray(free)
    scales = np.broadcast_to(np.asarray(scale, dtype=float), centre.shape)
    scatter = np.random.default_rng(0).standard_normal((copies, centre.size))
    around = np.concatenate([centre[None], centre + spread * scales * scatter])
    slope = kept(lambda points: map_members(jax.value_and_grad(loss), points))
    _, gradients = jax.device_get(slope(jnp.asarray(around, free.dtype)))
    probe = _probe(loss, centre, sizes, scales, np.asarray(gradients[0]), block)
    shares = _shares(names, saturated)
    judged = [
        judge(probe.along(i), relative_tolerance, shares[i]) for i in range(centre.size)
    ]
    errors, reaches, kinds, reasons = zip(*judged, strict=True)
    return GradientReport(
        names=tuple(names),
        free=centre,
        scale=scales,
        value=probe.value,
        noise=probe.noise,
        gradient=probe.gradient / scales,
        steps=sizes,
        differences=probe.differences / scales,
        changes=probe.changes,
        error=np.asarray(errors),
        reach=np.asarray(reaches),
        copies=np.asarray(gradients[1:], dtype=float),
        saturated=shares,
        kinds=kinds,
        verdicts=tuple(
            f"{k}: {r}" if r else str(k) for k, r in zip(kinds, reasons, strict=True)
        ),
    )


def _probe(
    loss: Loss,
    centre: np.ndarray,
    sizes: np.ndarray,
    scales: np.ndarray,
    gradient: np.ndarray,
    block: int,
) -> Probe:
    """Losses at all points that the differences need, beside the gradient."""
    points = difference_points(centre, sizes, scales)
    run = kept(lambda x: map_members(loss, x, block=block))
    losses = np.asarray(run(jnp.asarray(points)))
    return Probe.of(losses, points, sizes, scales, gradient)


def _check(
    free: Any, names: Sequence[str], sizes: np.ndarray, relative_tolerance: float
) -> None:
    if free.ndim != 1 or free.shape[0] != len(names) or not len(names):
        raise ValueError(
            "free must be one vector with a name for each number; received shape "
            f"{free.shape} and {len(names)} names."
        )
    if sizes.size < 2 or not sizes[0] > 0.0 or not sizes[-1] >= REALISTIC:
        raise ValueError(
            "steps must be two or more different positive numbers, the largest at "
            f"least {REALISTIC}; received {tuple(sizes.tolist())}."
        )
    if not relative_tolerance > 0.0:
        raise ValueError(
            f"relative_tolerance must be positive; received {relative_tolerance}."
        )


def saturation(metrics: Metrics) -> dict[str, float]:
    """Share of ticks in saturation by channel, the mean over members if there are any.

    Args:
        metrics: metrics of one run or of an ensemble.
    """
    return {
        channel: float(np.mean(getattr(metrics.channels, channel).time_saturated))
        for channel in CHANNELS
    }


def _shares(names: Sequence[str], saturated: Mapping[str, float] | None) -> np.ndarray:
    if not saturated:
        return np.full(len(names), np.nan)
    shares = []
    for name in names:
        parts = [_CHANNEL_OF.get(part, part) for part in name.split(".")]
        own = [saturated[part] for part in parts if part in saturated]
        shares.append(own[0] if own else min(saturated.values()))
    return np.asarray(shares, dtype=float)
