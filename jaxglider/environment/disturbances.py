"""External forces of the sea, realised from a key before the rollout starts.

A realised path holds the force at every tick, ends included; within a tick it is
interpolated linearly. For a sinusoid of angular frequency ω that costs a relative error
of (ω Δt)²/8: 3e-7 for the paper's at 20 Hz.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax

from jaxglider.core.containers import (
    Container,
    Scalar,
    Series,
    as_float,
    check_interval,
)
from jaxglider.core.numerics import sincos
from jaxglider.signals import BodyAxes, map_fields

FEW = 3
"""Terms of one kind that are realised one by one; more of them, in a loop."""


class AbstractDisturbance(Container):
    """A model of τ_d(t): external force [N] and moment [N m], body frame."""

    @abstractmethod
    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """One realisation.

        Args:
            key: random key; models without chance ignore it.
            times: the evenly spaced tick times [s], end of the last tick included.

        Returns:
            Force [N] and moment [N m] at those times.
        """


class Calm(AbstractDisturbance):
    """No disturbance, τ_d = 0."""

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """Zeros."""
        return BodyAxes(*(jnp.zeros_like(times) for _ in range(6)))


class Constant(AbstractDisturbance):
    """The same force for ever.

    Attributes:
        force: force [N] and moment [N m], body frame.
    """

    force: BodyAxes[Scalar]

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """The constant at each time."""
        return map_fields(lambda f: jnp.broadcast_to(f, times.shape), self.force)


class Sinusoid(AbstractDisturbance):
    """τ_d = A sin(ω t + φ₀) on each axis.

    Attributes:
        amplitude: A [N] and [N m], body frame.
        frequency: ω [rad/s].
        phase: φ₀ [rad].
    """

    amplitude: BodyAxes[Scalar]
    frequency: BodyAxes[Scalar]
    phase: BodyAxes[Scalar]

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """The sinusoid at each time, A cos φ₀ sin ωt + A sin φ₀ cos ωt.

        Members of an ensemble that differ in amplitude and phase share sin ωt.
        """

        def wave(a: Scalar, w: Scalar, p: Scalar) -> Series:
            sine, cosine = jax.vmap(sincos)(w * times)
            ahead, in_phase = sincos(p)
            return (a * in_phase) * sine + (a * ahead) * cosine

        return map_fields(wave, self.amplitude, self.frequency, self.phase)


class GaussMarkov(AbstractDisturbance):
    """Coloured noise: a stationary Ornstein-Uhlenbeck process on each axis.

    dx = −x/τ dt + σ √(2/τ) dW, discretised exactly:
    x_{k+1} = e^(−Δt/τ) x_k + σ √(1 − e^(−2Δt/τ)) ξ_k. Its variance is σ² at every time
    and its autocorrelation e^(−|t|/τ), whatever the tick.

    Attributes:
        standard_deviation: σ [N] and [N m], body frame.
        correlation_time: τ [s].

    Raises:
        ValueError: a standard deviation is negative or a correlation time not positive.
    """

    standard_deviation: BodyAxes[Scalar]
    correlation_time: BodyAxes[Scalar]

    def __check_init__(self) -> None:
        for axis in vars(self.standard_deviation):
            deviation = getattr(self.standard_deviation, axis)
            time = getattr(self.correlation_time, axis)
            owner = "GaussMarkov"
            check_interval(
                owner, f"standard_deviation.{axis}", deviation, 0.0, closed_low=True
            )
            check_interval(owner, f"correlation_time.{axis}", time, 0.0)

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """One sample path, started from the stationary distribution."""
        dt = times[1] - times[0]

        def path(own: jax.Array, sigma: Scalar, tau: Scalar) -> Series:
            shocks = sigma * jr.normal(own, times.shape, times.dtype)
            decay = jnp.exp(-dt / tau)
            spread = jnp.sqrt(-jnp.expm1(-2.0 * dt / tau))

            def advance(x: Scalar, shock: Scalar) -> tuple[Scalar, Scalar]:
                following = decay * x + spread * shock
                return following, following

            _, tail = lax.scan(advance, shocks[0], shocks[1:])
            return jnp.concatenate([shocks[:1], tail])

        keys = jax.vmap(lambda axis: jr.fold_in(key, axis))(jnp.arange(6))
        sigmas = jnp.stack(self.standard_deviation.fields())
        taus = jnp.stack(self.correlation_time.fields())
        return BodyAxes(*jax.vmap(path)(keys, sigmas, taus))


class Sum(AbstractDisturbance):
    """Several disturbances at once, each with its own key.

    Attributes:
        terms: the disturbances.
    """

    terms: tuple[AbstractDisturbance, ...]

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """The sum of the realisations."""
        kinds: dict[Any, list[int]] = {}
        for number, term in enumerate(self.terms):
            kinds.setdefault(jax.tree.structure(term), []).append(number)
        total = Calm().realise(key, times)
        for number, term in enumerate(self.terms):
            if len(kinds[jax.tree.structure(term)]) <= FEW:
                total = total + term.realise(jr.fold_in(key, number), times)
        for numbers in kinds.values():
            if len(numbers) > FEW:
                total = total + self._alike(key, numbers, times)
        return total

    def _alike(
        self, key: jax.Array, numbers: list[int], times: Series
    ) -> BodyAxes[Series]:
        """The sum of terms of one kind: one program, whatever their number."""
        terms = (self.terms[number] for number in numbers)
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *terms)

        def add(total: BodyAxes[Series], one: Any) -> tuple[BodyAxes[Series], None]:
            number, term = one
            return total + term.realise(jr.fold_in(key, number), times), None

        start = Calm().realise(key, times)
        return lax.scan(add, start, (jnp.asarray(numbers), stacked))[0]


class ScaledDisturbance(AbstractDisturbance):
    """Another disturbance, stronger or weaker and turned about the body's z axis.

    (x, y) ← s (x cos χ − y sin χ, x sin χ + y cos χ) for surge and sway as for roll
    and pitch; heave and yaw ← s times themselves.

    Attributes:
        disturbance: τ(t) as it comes.
        strength: s.
        direction: χ [rad], positive to starboard.
    """

    disturbance: AbstractDisturbance
    strength: Scalar = eqx.field(converter=as_float, default=1.0)
    direction: Scalar = eqx.field(converter=as_float, default=0.0)

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """The realisation, scaled and turned."""
        sine, cosine = sincos(self.direction)
        along, across = self.strength * cosine, self.strength * sine
        f = self.disturbance.realise(key, times)
        return BodyAxes(
            along * f.surge - across * f.sway,
            across * f.surge + along * f.sway,
            self.strength * f.heave,
            along * f.roll - across * f.pitch,
            across * f.roll + along * f.pitch,
            self.strength * f.yaw,
        )


def axes(
    surge: float = 0.0,
    sway: float = 0.0,
    heave: float = 0.0,
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
) -> BodyAxes[Scalar]:
    """Six numbers by name, zero where not given.

    Args:
        surge: number of the forward axis, a force [N] unless the use says otherwise.
        sway: number of the starboard axis [N].
        heave: number of the downward axis [N].
        roll: number about the forward axis, a moment [N m].
        pitch: number about the starboard axis [N m].
        yaw: number about the downward axis [N m].
    """
    return BodyAxes(surge, sway, heave, roll, pitch, yaw)
