"""Disturbance observers: what pushes the glider that the design model does not explain.

Source: Yang and Mahmoudian, Eqs. of the fixed-time sliding-mode disturbance observer,
per degree of freedom:

ϖ' = M⁻¹(F + d̂ + ι₁ φ₁(Π)),  d̂' = ι₂ φ₂(Π),  Π = M(ν − ϖ),
φ₁ = sig^½(Π) + ς sig^{3/2}(Π),  φ₂ = ½ sig⁰(Π) + 2ς Π + 3/2 ς² sig²(Π).

Deviation: with the paper's gains these are stiff. Explicit Euler blows up at 20 Hz and
still at 100 Hz, so the step is implicit, one scalar equation for each axis:

b = M(ν_next − ϖ) − Δt (F + d̂),  y + Δt ι₁ φ₁(y) + Δt² ι₂ φ₂(y) = b,
d̂ ← d̂ + Δt ι₂ φ₂(y),  ϖ ← ν_next − y/M.

Its left side rises with slope one or more, so the root exists, is unique, and has a
derivative by the implicit function theorem. The signed powers are smoothed (see
`numerics.signed_powers`): without that the derivative of a rollout is meaningless.
"""

import functools
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from jaxglider.core.compiler import not_inlined
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.elementary import exp2, log2
from jaxglider.core.numerics import barrier, implicit_root
from jaxglider.core.sets import FROM_ONE, OBSERVER_SET, POSITIVE, Coupled
from jaxglider.signals import (
    BodyAxes,
    Command,
    GliderState,
    Measurement,
    map_fields,
    zeros,
)
from jaxglider.vehicle.design_model import DesignModel


class AbstractObserver(Container):
    """Estimates the lumped disturbance d from how the velocity really changed."""

    @abstractmethod
    def init(self, state: GliderState) -> Any:
        """The observer's state before the first tick."""

    @abstractmethod
    def estimate(self, observer_state: Any) -> BodyAxes[Scalar]:
        """d̂ so far: force [N] and moment [N m], body frame."""

    @abstractmethod
    def step(
        self,
        observer_state: Any,
        measurement: Measurement,
        applied: Command[Scalar],
        following: GliderState,
        dt: Scalar,
    ) -> Any:
        """The observer's state one tick later.

        Args:
            observer_state: state from `init` or from the previous step.
            measurement: measurement at the start of the tick.
            applied: command held during the tick.
            following: measured state at the end of the tick.
            dt: tick [s].
        """


class NoObserver(AbstractObserver):
    """d̂ = 0."""

    def init(self, state: GliderState) -> BodyAxes[Scalar]:
        """Zeros."""
        return zeros(BodyAxes, state.surge)

    def estimate(self, observer_state: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
        """Zeros."""
        return observer_state

    def step(
        self,
        observer_state: BodyAxes[Scalar],
        measurement: Measurement,
        applied: Command[Scalar],
        following: GliderState,
        dt: Scalar,
    ) -> BodyAxes[Scalar]:
        """Zeros."""
        return observer_state


class ObserverState(eqx.Module):
    """State of the observer: its belief about velocity and disturbance.

    Attributes:
        velocity: ϖ [m/s, rad/s], body frame.
        disturbance: d̂ [N, N m], body frame.
    """

    velocity: BodyAxes[Scalar]
    disturbance: BodyAxes[Scalar]


_GAINS = Coupled(OBSERVER_SET, "proportional", "integral")


class FixedTimeObserver(AbstractObserver):
    """The fixed-time sliding-mode disturbance observer, stepped implicitly.

    Attributes:
        model: design model, the designer's belief about the glider.
        proportional: ι₁ per axis.
        integral: ι₂ per axis.
        stretch: ς per axis, weight of the terms that act far from the surface.
        smoothing: δ [kg m/s, kg m²/s] of the signed powers.
        newton_steps: iterations of the scalar root in double precision; in single one
            less, see `observer_root`.

    Raises:
        ValueError: a gain or the smoothing is not positive, or there is no step.
    """

    model: DesignModel
    proportional: BodyAxes[Scalar] = eqx.field(metadata={"set": _GAINS})
    integral: BodyAxes[Scalar] = eqx.field(metadata={"set": _GAINS})
    stretch: BodyAxes[Scalar] = eqx.field(metadata={"set": POSITIVE})
    smoothing: Scalar = eqx.field(
        converter=as_float, default=1e-3, metadata={"set": POSITIVE, "tuned": False}
    )
    newton_steps: int = eqx.field(static=True, default=6, metadata={"set": FROM_ONE})

    def init(self, state: GliderState) -> ObserverState:
        """ϖ = ν and d̂ = 0."""
        return ObserverState(state.velocity(), zeros(BodyAxes, state.surge))

    def estimate(self, observer_state: ObserverState) -> BodyAxes[Scalar]:
        """d̂ [N] and [N m]."""
        return observer_state.disturbance

    def step(
        self,
        observer_state: ObserverState,
        measurement: Measurement,
        applied: Command[Scalar],
        following: GliderState,
        dt: Scalar,
    ) -> ObserverState:
        """One implicit step on each axis."""
        force = self.model.force(measurement.state, measurement.attitude, applied)
        inertia = self.model.parameters.inertia()
        velocity = following.velocity()

        def mismatch(m: Scalar, v: Scalar, w: Scalar, f: Scalar, d: Scalar) -> Scalar:
            return m * (v - w) - dt * (f + d)

        target = map_fields(
            mismatch,
            inertia,
            velocity,
            observer_state.velocity,
            force,
            observer_state.disturbance,
        )
        root = map_fields(
            lambda b, i1, i2, s: observer_root(
                b, (dt * i1, dt * dt * i2, s, self.smoothing), self.newton_steps
            ),
            target,
            self.proportional,
            self.integral,
            self.stretch,
        )
        change = map_fields(
            lambda y, i2, s: dt * i2 * _phi2(y, s, self.smoothing),
            root,
            self.integral,
            self.stretch,
        )
        return ObserverState(
            velocity - root / inertia, observer_state.disturbance + change
        )


@jax.named_scope("observer_root")
def observer_root(
    target: Scalar, gains: tuple[Scalar, Scalar, Scalar, Scalar], steps: int
) -> Scalar:
    """Solve y + a₁ φ₁(y) + a₂ φ₂(y) = b for y.

    Within 1e-9 after six steps for gains up to six decades from the paper's either way,
    Δt up to 0.1 s and |b| up to 1e4: more than a search comes to. To rounding after
    four within one decade. The derivative is that of the exact root and never runs
    through the iterations.

    Args:
        target: b.
        gains: a₁ = Δt ι₁, a₂ = Δt² ι₂, ς and the smoothing δ.
        steps: number of Newton steps in double precision. Each doubles the digits that
            are right: single precision has them all one step earlier, and leaves out
            the last.
    """
    single = jnp.finfo(jnp.result_type(target)).bits < 64
    iterations = max(steps - 1, 1) if single else steps

    fixed = lax.stop_gradient(gains)
    root = _newton_roots(iterations)(
        lax.stop_gradient(target), fixed, _least_rest(fixed)
    )
    return implicit_root(_left_side, root, target, gains)


@functools.cache
def _newton_roots(steps: int) -> Callable[..., Scalar]:
    """`_newton_root` of some steps: one function, traced once for all six axes."""

    def newton_root(target: Scalar, gains: tuple[Scalar, ...], least: Scalar) -> Scalar:
        return _newton_root(target, gains, least, steps)

    return not_inlined(newton_root)


def _least_rest(gains: tuple[Scalar, ...]) -> Scalar:
    """The rest for the other terms where b = ½ a₂: see `_newton_root`.

    Of the gains alone, so that a compiler takes it out of the loop over time.
    """
    _, a2, stretch, smoothing = gains
    linear = smoothing * (1.0 + 2.0 * a2 * stretch)
    return _cube_root(0.25 * a2 * linear * linear)


def _newton_root(
    target: Scalar, gains: tuple[Scalar, ...], least: Scalar, steps: int
) -> Scalar:
    """The root, by Newton's method on r = (y² + δ²)^¼.

    The left side is y P(r)/r² with a polynomial P, hence y = b r²/P(r), and r is the
    root of F(r) = r⁴ − δ² − b² r⁴/P². The steps are Newton's for F √P/r², which is
    nearly straight, with all fractions taken out: N = F P².

    The first guess is the harmonic mean of two that are too large: of the root of the
    terms in y and y² together, and of the smaller of those in √y and y^{3/2} alone.
    What the half sign of φ₂ leaves for them is |b| − ½ a₂ far from zero; where the two
    are near each other the sign is still short of one by ½ (δ/y)².
    """
    a1, a2, stretch, smoothing = gains
    size, floor = jnp.abs(target), smoothing * smoothing
    p0, p2 = 0.5 * a2, 1.0 + 2.0 * a2 * stretch
    p3, p4 = a1 * stretch, 1.5 * a2 * stretch * stretch
    left = size - p0
    beyond = 0.5 * (left + jnp.sqrt(left * left + 4.0 * least * least))
    short = jnp.maximum(smoothing / (smoothing + p0), least / p0)
    rest = jnp.where(left < 0.0, jnp.minimum(beyond, size * short), beyond)
    smooth = 2.0 * rest / (p2 + jnp.sqrt(p2 * p2 + 4.0 * p4 * rest))
    rooted = (rest / a1) * jnp.maximum(rest / a1, jnp.sqrt(smoothing))
    far = _cube_root(rest / p3)
    rough = jnp.minimum(rooted, far * far)
    # Well below δ the guess does not matter, so that a share of δ keeps it from 0/0.
    guess = smooth * rough / (smooth + rough + 1e-6 * smoothing)
    # √(y² + δ²) within 8 %.
    length = jnp.maximum(guess, smoothing) + 0.41 * jnp.minimum(guess, smoothing)
    r = jnp.sqrt(length)
    pull = target * target

    def polynomial(r: Scalar) -> tuple[Scalar, Scalar]:
        """P and r P'."""
        q = r * r
        u, v, w = a1 * r, p3 * r, p4 * q
        value = (p0 + u) + q * ((p2 + v) + w)
        return value, u + q * ((2.0 * p2 + 3.0 * v) + 4.0 * w)

    for _ in range(steps):
        r = barrier(r)
        p, rise = polynomial(r)
        fourth, squared = (r * r) * (r * r), p * p
        pulled = pull * fourth
        n = (fourth - floor) * squared - pulled
        slope = 2.0 * (n + 2.0 * floor * squared) * p + (2.0 * pulled + 0.5 * n) * rise
        r = r * jnp.clip(1.0 - p * n / slope, 0.5, 2.0)
    return target * (r * r) / polynomial(r)[0]


def _cube_root(x: Scalar) -> Scalar:
    return exp2(log2(x) * (1.0 / 3.0))


def _left_side(
    y: Scalar, gains: tuple[Scalar, Scalar, Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    """y + a₁ φ₁(y) + a₂ φ₂(y) = y h(|y|) and its slope, from one chain of two roots.

    With |y| smoothed, h is a sum of powers of it from −1 to 1, and
    slope = h + (y/|y|)² (|y| dh/d|y|).
    """
    a1, a2, stretch, smoothing = gains
    size, inverse = _modulus(y, smoothing)
    near1 = a1 * lax.rsqrt(size)
    far1 = stretch * size * near1
    near2, far2 = 0.5 * a2 * inverse, 1.5 * a2 * stretch * stretch * size
    h = 1.0 + 2.0 * a2 * stretch + (near1 + far1) + (near2 + far2)
    lean = y * inverse
    return y * h, h + lean * lean * (0.5 * (far1 - near1) + far2 - near2)


def _phi2(y: Scalar, stretch: Scalar, smoothing: Scalar) -> Scalar:
    size, inverse = _modulus(y, smoothing)
    return y * (0.5 * inverse + 2.0 * stretch + 1.5 * stretch * stretch * size)


def _modulus(y: Scalar, smoothing: Scalar) -> tuple[Scalar, Scalar]:
    """√(y² + δ²) and its reciprocal, from one root."""
    squared = y * y + smoothing * smoothing
    inverse = lax.rsqrt(squared)
    return squared * inverse, inverse
