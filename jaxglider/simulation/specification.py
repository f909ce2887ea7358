"""The specification: what is prescribed, whoever steers and whatever it is tuned to.

P_spec(t*) bounds each error, |φ| a bank limit, and each error has to have settled by a
required time. A law has a funnel of its own, which it transforms its errors with; it is
judged by this one. Where P(t*) ≤ P_spec(t*) for all t*, and δ ≤ δ_spec, an error inside
the law's funnel is inside the specification: `bounds_of_a_funnel_inside` gives the
initial value, final bound and settling time for which that holds by construction.
"""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.control.prescribed.funnel import Funnel, Limits
from jaxglider.control.prescribed.performance import (
    AbstractPerformanceFunction,
    Bound,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.sets import POSITIVE, UNIT_CLOSED, Interval
from jaxglider.signals import Channels, map_fields

BANK_LIMIT = math.pi / 4
"""Largest roll [rad] where nothing else is specified, of gliders whose roll is real."""

_Known = SechFunction | HalfSechFunction | ExponentialFunction

_LATE = 1e9
"""A time at which every performance function has settled [s]."""
_GRID = 4001
"""Instants at which two performance functions are compared."""


class Specification(Container):
    """The bounds prescribed for a run: errors, settling, roll, saturation.

    Attributes:
        funnel: P_spec and the edges −δ_L P_spec, δ_R P_spec of each channel.
        settling_time: time after a restart from which on each error has to be within
            its final bound [s]; None for those of the funnel. Also what the theory's
            bounds on the settling of surface and error are held below.
        largest_roll: bank limit on |φ| [rad]; None for none.
        saturated_share: largest share of the time that an actuator may be short of its
            command; None for any.

    Raises:
        ValueError: a number is outside its set.
    """

    funnel: Funnel
    settling_time: Channels[Scalar] | None = eqx.field(
        default=None, metadata={"set": POSITIVE, "unit": "s"}
    )
    largest_roll: Scalar | None = eqx.field(
        converter=as_float, default=None, metadata={"set": POSITIVE, "unit": "rad"}
    )
    saturated_share: Scalar | None = eqx.field(
        converter=as_float, default=None, metadata={"set": UNIT_CLOSED}
    )

    def bounds(self, clock: Scalar) -> Channels[Bound]:
        """P_spec of each channel at t* [s]; its final bound once it has to be settled.

        Before the required time it is the funnel's P, and so it is for a required time
        after that of the funnel.
        """
        bounds = self.funnel.bounds(clock)
        if self.settling_time is None:
            return bounds
        final = self.funnel.bounds(jnp.full_like(clock, _LATE))

        def settle(b: Bound, end: Bound, time: Scalar) -> Bound:
            due = clock >= time
            return jax.tree.map(lambda x, last: jnp.where(due, last, x), b, end)

        return map_fields(settle, bounds, final, self.settling_time)

    def limits(self, bounds: Channels[Bound]) -> Channels[Limits]:
        """−δ_L P_spec and δ_R P_spec of each channel."""
        return self.funnel.limits(bounds)

    def required_settling(self) -> Channels[Scalar | None]:
        """Required settling time of each channel [s]; None where nothing says one."""
        if self.settling_time is not None:
            return self.settling_time
        return map_fields(
            lambda p: getattr(p, "settling_time", None), self.funnel.performance
        )

    def with_funnel(self, funnel: Funnel) -> "Specification":
        """The same with another P_spec."""
        return dataclasses.replace(self, funnel=funnel)


@dataclasses.dataclass(frozen=True)
class FunnelBounds:
    """A box of performance functions of one form, all inside one that is specified.

    Attributes:
        initial: P₀ of the form.
        final_bound: largest P_∞ [unit of the channel].
        settling_time: largest T [s].
    """

    initial: Interval
    final_bound: float
    settling_time: float


def bounds_of_a_funnel_inside(
    form: type[AbstractPerformanceFunction], specified: AbstractPerformanceFunction
) -> FunnelBounds | None:
    """Bounds on P₀, P_∞ and T that keep P(t*) ≤ P_spec(t*) for all t* ≥ 0.

    Each form is P = f(P₀, z) + P_∞ for t* < T with z = T/(T − t*), and P_∞ from then
    on. Where all of the following hold, P grows with T and with P_∞, and one corner of
    the box bounds all of it:

    - z = 1/(1 − t*/T) falls as T grows, and f falls as z grows: sech(a z) and
      ½ sech(a z) with a > 0 do, and so does (P₀ − 1 + 1/z) e^{1−z} for P₀ ≥ 1, the
      exponential form, as a product of two factors that are not negative and fall.
    - So f grows with T at any t* < T, and past T it is 0, its limit: P grows with T.
    - In P₀: sech(sech(P₀) z) grows, since sech(P₀) falls; the exponential form grows;
      ½ sech(P₀ z) falls.

    *One form inside itself*: P₀ at most (the half form: at least) that specified, P_∞
    and T at most those specified. *The half form inside the sech form*: with
    a = sech(P₀,spec), P₀ ≥ a gives ½ sech(P₀ z) ≤ ½ sech(a z) < sech(a z). In both the
    box cannot be larger in one number while the others reach their ends: near T the
    exponents decide. *Otherwise* P₀ is let go as far as P_∞ = P_∞,spec lets P(0) be,
    and T is the largest found by bisection for which P(tᵢ) ≤ P_spec(tᵢ₊₁) on a grid.
    As both functions fall, that proves P ≤ P_spec between tᵢ and tᵢ₊₁ as well.

    Args:
        form: class of the performance function to be kept inside.
        specified: P_spec of the channel, concrete.

    Returns:
        The box, or None where nothing of this form fits: it starts too high whatever
        its numbers are, or one of the two is a form not known here.
    """
    if not issubclass(form, _Known) or not isinstance(specified, _Known):
        return None
    spec = {name: float(value) for name, value in vars(specified).items()}
    initial, bound, time = spec["initial"], spec["final_bound"], spec["settling_time"]
    if type(specified) is form:
        lowest = 1.0 if form is ExponentialFunction else 0.0
        closed = form is ExponentialFunction
        span = Interval(lowest, initial, closed_low=closed, closed_high=True)
        if form is HalfSechFunction:
            span = Interval(initial, closed_low=True)
        return FunnelBounds(span, bound, time)
    if form is HalfSechFunction and type(specified) is SechFunction:
        return FunnelBounds(
            Interval(1.0 / math.cosh(initial), closed_low=True), bound, time
        )
    return _by_bisection(form, specified, bound, time)


def falling_part(form: type[AbstractPerformanceFunction], initial: Scalar) -> Scalar:
    """P(0) − P_∞ of a form, given its P₀.

    sech(sech P₀), ½ sech P₀, or P₀ for the exponential form.
    """
    if form is SechFunction:
        return 1.0 / jnp.cosh(1.0 / jnp.cosh(initial))
    if form is HalfSechFunction:
        return 0.5 / jnp.cosh(initial)
    return initial


def initial_of(form: type[AbstractPerformanceFunction], falling: Scalar) -> Scalar:
    """P₀ of a form, given P(0) − P_∞: the inverse of `falling_part` on its range.

    Outside the range the nearest end of it: 0, 10, or 1 for the exponential form.
    """
    if form is SechFunction:
        share = _arcsech(falling)
        return jnp.where(falling <= 1.0 / math.cosh(1.0), 0.0, _arcsech(share))
    if form is HalfSechFunction:
        return _arcsech(2.0 * falling)
    return jnp.maximum(falling, 1.0)


def _arcsech(y: Scalar) -> Scalar:
    """The inverse of sech up to 10; kept clear of 1, where its slope is infinite."""
    clear = max(1e-9, 8.0 * float(jnp.finfo(jnp.result_type(y, float)).eps))
    return jnp.arccosh(1.0 / jnp.clip(y, 1.0 / math.cosh(10.0), 1.0 - clear))


def _by_bisection(
    form: type[_Known],
    specified: _Known,
    bound: float,
    time: float,
) -> FunnelBounds | None:
    """The box of a form inside one of another form, its T found by bisection."""
    top = float(specified(jnp.asarray(0.0)).value) - bound
    smallest = {SechFunction: 1.0 / math.cosh(1.0), ExponentialFunction: 1.0}
    if top <= smallest.get(form, 0.0):
        return None
    # A hundredth below the specified start, so that there is a T > 0 for it.
    reach = 0.99 * top
    if form is HalfSechFunction:
        least = float(initial_of(form, jnp.asarray(min(reach, 0.499))))
        initial, span = least, Interval(least, closed_low=True)
    else:
        limit = 0.999 if form is SechFunction else math.inf
        initial = float(initial_of(form, jnp.asarray(min(reach, limit))))
        if form is SechFunction:
            # sech(P₀) stays above P_∞.
            initial = min(initial, math.acosh(1.0 / min(1.0, 1.001 * bound)))
        low = 1.0 if form is ExponentialFunction else 0.0
        span = Interval(
            low, initial, closed_low=form is ExponentialFunction, closed_high=True
        )
        if not initial > low:
            return None
    low, high = 0.0, time
    for _ in range(40):
        middle = 0.5 * (low + high)
        corner = form(initial, bound, middle)
        low, high = (middle, high) if _inside(corner, specified) else (low, middle)
    return FunnelBounds(span, bound, low) if low > 1e-3 * time else None


def _inside(one: _Known, other: _Known) -> bool:
    """Whether P(tᵢ) ≤ P_spec(tᵢ₊₁) on a grid up to the end of both."""
    end = float(other.settling_time)
    grid = jnp.asarray(np.linspace(0.0, end, _GRID))
    mine, theirs = (np.asarray(jax.vmap(p)(grid).value) for p in (one, other))
    return bool(np.all(mine[:-1] <= theirs[1:] + 1e-12))
