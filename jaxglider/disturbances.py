"""External forces of the sea, realised from a key before the rollout starts.

A realised path holds the force at every tick, ends included; within a tick it is
interpolated linearly. For a sinusoid of angular frequency ω that costs a relative error
of (ω Δt)²/8: 3e-7 for the paper's at 20 Hz.
"""

from abc import abstractmethod

import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax

from jaxglider._types import Container, Scalar, Series, check_interval
from jaxglider.numerics import sincos
from jaxglider.signals import BodyAxes, each


class AbstractDisturbance(Container):
    """A law for τ_d(t): external force [N] and moment [N m], body frame."""

    @abstractmethod
    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """One realisation.

        Args:
            key: random key; laws without chance ignore it.
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
        force: [N] and [N m], body frame.
    """

    force: BodyAxes[Scalar]

    def realise(self, key: jax.Array, times: Series) -> BodyAxes[Series]:
        """The constant at each time."""
        return each(lambda f: jnp.broadcast_to(f, times.shape), self.force)


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
        """The sinusoid at each time."""
        sine = jax.vmap(lambda angle: sincos(angle)[0])
        return each(
            lambda a, w, p: a * sine(w * times + p),
            self.amplitude,
            self.frequency,
            self.phase,
        )


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
        total = Calm().realise(key, times)
        for number, term in enumerate(self.terms):
            total = total + term.realise(jr.fold_in(key, number), times)
        return total


def axes(
    surge: float = 0.0,
    sway: float = 0.0,
    heave: float = 0.0,
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
) -> BodyAxes[Scalar]:
    """Six numbers by name, zero where not given: [N] and [N m], or as the use says."""
    return BodyAxes(surge, sway, heave, roll, pitch, yaw)


def same_on_all_axes(value: float) -> BodyAxes[Scalar]:
    """One number for all six axes."""
    return BodyAxes(*(value,) * 6)
