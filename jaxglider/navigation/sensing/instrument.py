"""Sensors on board: when each samples, and what is wrong with what it says.

At the first tick at or after each multiple of its period a sensor takes a sample,

y = Q(x + b + Σ a_n sin(n ψ + φ_n) + σ ξ),

which is shown from the first tick on that is later by its latency, and held until the
next one is shown. b is the bias of a deployment, ξ standard normal, Q rounds to the
quantum, and the sum, of the compass alone, is what iron on board leaves of an error
that turns with the heading. Some samples are lost.

All chance is realised before the run. Rounding has the derivative of what is rounded:
its own is zero almost everywhere, and would hide every gain behind it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax

from jaxglider.core.containers import Container, Scalar, Series, as_float
from jaxglider.core.numerics import sincos
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE, SHARE

_EARLY = 1e-3
"""Share of a period by which a tick may be early: times are rounded."""


class Instrument(Container):
    """One sensor.

    Attributes:
        period: time from one sample to the next [s]; a shorter one than the tick is the
            tick.
        latency: time from a sample to its showing [s], shorter than the period.
        noise: σ, standard deviation of the white noise [unit of the quantity].
        bias: known bias [unit of the quantity].
        bias_deviation: standard deviation of the bias of a deployment about it [unit of
            the quantity].
        quantum: step of the numbers that it gives [unit of the quantity]; 0 for none.
        lost: share of the samples that are lost.

    Raises:
        ValueError: a number is out of its range, or the latency is as long as the
            period.
    """

    period: Scalar = eqx.field(converter=as_float, metadata={"set": POSITIVE})
    latency: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )
    noise: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )
    bias: Scalar = eqx.field(converter=as_float, default=0.0)
    bias_deviation: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )
    quantum: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )
    lost: Scalar = eqx.field(converter=as_float, default=0.0, metadata={"set": SHARE})

    def __check_init__(self) -> None:
        late = (self.latency >= self.period) & (self.period > 0.0)
        if not isinstance(late, jax.core.Tracer) and bool(late):
            raise ValueError(
                f"{type(self).__name__}.latency must be shorter than the period of "
                f"{float(self.period):g} s; received {float(self.latency):g}."
            )

    def realise(self, key: jax.Array, times: Series) -> "Samples":
        """The samples at the given ticks.

        Args:
            key: random key of this sensor in this run.
            times: times of the ticks, from zero on [s].
        """
        bias_key, noise_key, loss_key = jr.split(key, 3)
        # No more than one sample a tick: the numbers of samples are those of rows.
        step = times[1] - times[0] if times.shape[0] > 1 else self.period
        period = jnp.maximum(self.period, step)
        kept = jr.uniform(loss_key, times.shape, times.dtype) >= self.lost
        number = jnp.floor(times / period + _EARLY).astype(int)
        # Before the first sample is shown there is none: number −1.
        shown = jnp.floor((times - self.latency) / period + _EARLY).astype(int)
        taken, showing = _changes(number), _changes(shown) & (shown >= 0)
        at = jnp.ceil(jnp.maximum(shown, 0) * period / step - _EARLY) * step
        showing = showing & kept[jnp.maximum(shown, 0)]
        # At the start the glider knows what its sensors would say.
        newest = lax.cummax(jnp.where(showing, at, 0.0))
        bias = self.bias + self.bias_deviation * jr.normal(bias_key, (), times.dtype)
        noise = self.noise * jr.normal(noise_key, times.shape, times.dtype)
        return Samples(
            error=bias + noise,
            taken=taken & kept[number],
            shown=showing,
            at_once=number == shown,
            age=times - newest,
        )

    def reading(self, value: Scalar, sample: "Samples") -> Scalar:
        """The number that the sensor gives for a true value.

        Args:
            value: true value [unit of the quantity].
            sample: row of its samples.
        """
        return _rounded(value + sample.error, self.quantum)


class Compass(Instrument):
    """A compass, whose error turns with the heading.

    Attributes:
        once: a₁, standard deviation of what goes once round with the heading [rad].
        twice: a₂, standard deviation of what goes twice round [rad].
    """

    once: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )
    twice: Scalar = eqx.field(
        converter=as_float, default=0.0, metadata={"set": NOT_NEGATIVE}
    )

    def realise(self, key: jax.Array, times: Series) -> "Samples":
        """The samples, with the swing of this deployment: a sin ψ + b cos ψ, and twice.

        Args:
            key: random key of this sensor in this run.
            times: times of the ticks, from zero on [s].
        """
        plain = super().realise(jr.fold_in(key, 0), times)
        parts = jr.normal(jr.fold_in(key, 1), (4,), times.dtype)
        sizes = jnp.stack([self.once, self.once, self.twice, self.twice])
        swing = jnp.broadcast_to(parts * sizes, (*times.shape, 4))
        return Samples(**{**vars(plain), "swing": swing})

    def reading(self, value: Scalar, sample: "Samples") -> Scalar:
        """The heading that it gives [rad].

        Args:
            value: true heading [rad].
            sample: row of its samples.
        """
        if sample.swing is None:
            return super().reading(value, sample)
        sine, cosine = sincos(value)
        parts = sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine
        turned = sum(sample.swing[n] * part for n, part in enumerate(parts))
        return super().reading(value + turned, sample)


class Samples(eqx.Module):
    """The samples of one sensor, tick by tick; the scan hands on one row.

    Attributes:
        error: bias and noise of a sample taken now [unit of the quantity].
        taken: flag, a good sample is taken now.
        shown: flag, the newest good sample is shown from now on.
        at_once: flag, the sample to show is the one that is taken in the same tick.
        age: time since the sample that is shown was taken [s].
        swing: amplitudes of sin ψ, cos ψ, sin 2ψ and cos 2ψ [rad], or None.
    """

    error: jax.Array
    taken: jax.Array
    shown: jax.Array
    at_once: jax.Array
    age: jax.Array
    swing: jax.Array | None = None


def _changes(number: jax.Array) -> jax.Array:
    """Places where a count differs from the one before; the first always does."""
    return jnp.concatenate([jnp.ones(1, bool), number[1:] != number[:-1]])


def _rounded(value: Scalar, quantum: Scalar) -> Scalar:
    step = jnp.where(quantum > 0.0, quantum, 1.0)
    off = jnp.where(quantum > 0.0, jnp.round(value / step) * step - value, 0.0)
    return value + lax.stop_gradient(off)
