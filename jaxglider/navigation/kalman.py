"""The model-aided filter: an extended Kalman filter on the design model.

It predicts with the equations of motion of the design model and with what the glider
knows that it has told its actuators: so it sees an inflection coming, where one that
only differentiates depths has to wait for them. Beside the state it estimates what the
model has wrong: an excess mass (density, ballast), a share of drag, and three moments,
each a random walk; and what the depth sensor shows at the surface, its zero, which the
model of a floating hull gives away.

x⁻ = f(x, U),  P⁻ = F P Fᵀ + Q Δt,  F = ∂f/∂x by forward differentiation; then for each
fresh reading of depth, roll, pitch and heading, one after the other, with h what it is
of the state (depth and zero together, or one angle) and p = P⁻ h,

k = p/(h p + σ²),   x = x⁻ + k (y − h x⁻),   P = P⁻ − k pᵀ − p kᵀ + (h p + σ²) k kᵀ,

the form of Joseph for a reading of one component. A reading that is τ seconds old is
compared with h (x⁻ − τ x'). A surprise beyond a number of standard deviations is not
believed, unless it lasts. Where that of an angle lasts for ten seconds, the rates are
wrong as well: a filter may turn round once from sample to sample, hit each reading, and
have all the rest wrong. It begins again then, and so where it is no longer finite.

Source: P. S. Maybeck, Stochastic Models, Estimation, and Control (1979, 1982). Filters
of libraries take a reading as a vector that always comes whole; these come one by one,
each in its own time, and the update of one component is three lines.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxglider.core.containers import Scalar, as_float
from jaxglider.core.rotations import ned_to_body, wrap
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.core.sets import FROM_ONE, POSITIVE
from jaxglider.environment.surface import emerged_weight
from jaxglider.navigation.estimator import (
    ABSURD,
    AbstractEstimator,
    Innovation,
    Moves,
    innovation,
)
from jaxglider.navigation.sensing.readings import Readings, Sensed
from jaxglider.signals import BodyAxes, Command, GliderState, map_fields
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.plant import kinematics

STATES = (
    *("depth", "roll", "pitch", "heading"),
    *("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate"),
)
"""Estimated states of the glider, in the order of the vector."""
_EXCESS = ("mass", "drag", "roll_moment", "pitch_moment", "yaw_moment")
_ROLL = STATES.index("roll")
_ZERO = len(STATES) + len(_EXCESS)
"""Place of the depth sensor's zero in the vector: the last."""
_READ = 4
"""Number of states that are read: the first ones."""
_FIRST_DEVIATION = (
    0.2,
    *(0.02,) * 3,
    *(0.05,) * 3,
    *(0.01,) * 3,
    0.02,
    0.1,
    *(0.1,) * 3,
)
"""Standard deviations before the first reading [m, rad, m/s, rad/s, kg, 1, N m]; the
depth sensor's zero has the filter's own."""
_LARGEST = (
    *(np.inf, np.inf, 1.5, np.inf),
    *(3.0,) * 3,
    *(2.0,) * 3,
    *(1.0, 0.6),
    *(3.0,) * 3,
    5.0,
)
"""Moduli that no estimate exceeds, in the same units."""
_ASTRAY = 10.0
"""Time [s] from which a surprise that lasts means that the rates are wrong as well."""
_LOST = 1e6
"""Variance of any state from which the filter begins again."""


class KalmanState(eqx.Module):
    """Belief of the filter.

    Attributes:
        mean: x: the states of `STATES`, then excess mass [kg], share of drag, moments
            [N m] and the depth sensor's zero [m].
        covariance: P.
        missed: number of readings in a row that were not believed.
    """

    mean: Float[Array, " n"]
    covariance: Float[Array, "n n"]
    missed: Sensed[Scalar]


def _walk(unit: str) -> Any:
    return eqx.field(converter=as_float, metadata={"unit": unit, "set": POSITIVE})


class ModelAided(AbstractEstimator):
    """The extended Kalman filter on the design model.

    Attributes:
        model: design model.
        noise: σ of the readings [m, rad].
        acceleration: square root of the spectral density of what accelerates the glider
            and is not modelled [m/s² √s].
        turning: square root of that of what turns it [rad/s² √s].
        mass_walk: growth of the excess mass in a square root of time [kg/√s].
        drag_walk: growth of the share of drag [1/√s].
        moment_walk: growth of the moments [N m/√s].
        gate: number of standard deviations up to which a reading is believed.
        zero: standard deviation of the depth sensor's zero before the first reading
            [m].
        steps: integration steps in a tick.

    Raises:
        ValueError: a number is not positive.
    """

    model: DesignModel
    noise: Sensed[Scalar] = eqx.field(metadata={"set": POSITIVE})
    acceleration: Scalar = _walk("m_s1.5")
    turning: Scalar = _walk("rad_s1.5")
    mass_walk: Scalar = _walk("kg_s0.5")
    drag_walk: Scalar = _walk("s0.5")
    moment_walk: Scalar = _walk("N_m_s0.5")
    gate: Scalar = eqx.field(
        converter=as_float, default=6.0, metadata={"set": POSITIVE, "tuned": False}
    )
    zero: Scalar = eqx.field(
        converter=as_float,
        default=0.3,
        metadata={"unit": "m", "set": POSITIVE, "tuned": False},
    )
    steps: int = eqx.field(static=True, default=1, metadata={"set": FROM_ONE})

    def stepped(self, steps: int) -> "ModelAided":
        """The filter that integrates its model in some steps."""
        return dataclasses.replace(self, steps=steps)

    def init(self, state: GliderState) -> KalmanState:
        """On deck, at rest; nothing known to be wrong."""
        values = Sensed.of(state).fields()
        missed = Sensed(*(jnp.zeros_like(x) for x in values))
        return KalmanState(*self._begun(values), missed)

    def estimate(self, estimator_state: KalmanState) -> GliderState:
        """The state."""
        return _glider(estimator_state.mean)

    def step(
        self,
        estimator_state: KalmanState,
        readings: Readings,
        moves: Moves,
        truth: GliderState,
        dt: Scalar,
    ) -> KalmanState:
        """Predict over the tick, then take the fresh readings one by one."""
        before = estimator_state

        def ahead(mean: Array) -> tuple[Array, Array]:
            after = self._predicted(mean, moves, dt)
            return after, after

        slope, mean = jax.jacfwd(ahead, has_aux=True)(before.mean)
        growth = dt * self._spread(dt)
        covariance = slope @ before.covariance @ slope.T + jnp.diag(growth)
        glider = _glider(mean)
        _, _, *rates = kinematics(glider, glider.attitude())
        missed, astray = [], jnp.asarray(False)
        parts = zip(
            readings.sensed.fields(),
            self.noise.fields(),
            before.missed.fields(),
            rates,
            strict=True,
        )
        for n, (reading, sigma, count, rate) in enumerate(parts):
            expected = mean[n] - reading.age * rate
            if n == 0:
                expected = expected + mean[_ZERO]
            surprise = reading.value - expected
            if n > 0:
                surprise = wrap(surprise)
            mean, covariance, seen = self._read(
                n, (mean, covariance, count), reading, surprise, sigma
            )
            missed.append(seen.missed)
            if n > 0:
                astray = astray | (seen.lost & (count * dt > _ASTRAY))
        largest = jnp.asarray(_LARGEST, mean.dtype)
        mean = jnp.clip(mean, -largest, largest)
        # A wild reading may have left whole turns behind.
        mean = mean.at[_ROLL].set(wrap(mean[_ROLL]))
        # Not even the readings need be numbers then.
        known = [
            jnp.where(jnp.abs(r.value) <= ABSURD, r.value, 0.0)
            for r in readings.sensed.fields()
        ]
        anew = self._begun(known)
        lost = ~jnp.all(jnp.isfinite(mean)) | ~jnp.all(jnp.isfinite(covariance))
        lost = lost | astray | jnp.any(jnp.diagonal(covariance) > _LOST)
        return KalmanState(
            jnp.where(lost, anew[0], mean),
            jnp.where(lost, anew[1], covariance),
            Sensed(*missed),
        )

    def _read(
        self,
        n: int,
        belief: tuple[Array, Array, Scalar],
        reading: Any,
        surprise: Scalar,
        sigma: Scalar,
    ) -> tuple[Array, Array, Innovation]:
        """Mean and covariance with the reading of one component, and its surprise."""
        mean, covariance, count = belief
        _, spread = _shown(covariance, n)
        limit = self.gate * jnp.sqrt(spread + sigma * sigma)
        seen = innovation(reading, surprise, lax.stop_gradient(limit), count)
        # Lost for long, it is more likely to be wrong itself than the sensor.
        doubt = jnp.where(seen.lost, seen.value**2, 0.0)
        covariance = covariance.at[n, n].add(doubt)
        column, spread = _shown(covariance, n)
        total = spread + sigma * sigma
        gain = jnp.where(seen.believed, column / total, 0.0)
        outer = jnp.outer(gain, column)
        covariance = covariance - outer - outer.T + total * jnp.outer(gain, gain)
        return mean + gain * seen.value, covariance, seen

    def _begun(self, read: Sequence[Scalar]) -> tuple[Array, Array]:
        """Mean and covariance of a filter that knows depth and attitude alone."""
        unknown = [jnp.zeros_like(read[0])] * (_ZERO + 1 - _READ)
        mean = jnp.stack([*read, *unknown])
        deviation = jnp.asarray(_FIRST_DEVIATION, mean.dtype)
        deviation = jnp.append(deviation, self.zero.astype(mean.dtype))
        return mean, jnp.diag(deviation**2)

    def _spread(self, dt: Scalar) -> Array:
        """Diagonal of Q: growth of the variances in a second."""
        zero = jnp.zeros_like(dt)
        walks = [zero] * 4 + [self.acceleration] * 3 + [self.turning] * 3
        walks += [self.mass_walk, self.drag_walk] + [self.moment_walk] * 3
        walks += [zero]
        return jnp.stack(walks) ** 2

    def _predicted(self, mean: Array, moves: Moves, dt: Scalar) -> Array:
        """The mean one tick later, the actuators moved evenly over it."""
        step = dt / self.steps

        def one(x: Array, number: Scalar) -> tuple[Array, None]:
            def rate(at: Array, node: Scalar) -> Array:
                share = (number + node) / self.steps
                command = map_fields(
                    lambda a, b: a + share * (b - a), moves.start, moves.end
                )
                return self._rate(at, command)

            return runge_kutta_step(RK4, rate, x, step), None

        numbers = jnp.arange(self.steps, dtype=mean.dtype)
        if self.steps == 1:
            return one(mean, numbers[0])[0]
        return lax.scan(one, mean, numbers)[0]

    def _rate(self, mean: Array, command: Command[Scalar]) -> Array:
        """Time derivative of the mean."""
        glider = _glider(mean)
        mass, drag, *moments = mean[len(STATES) : _ZERO]
        a, parameters = glider.attitude(), self.model.parameters
        zero = jnp.zeros_like(mass)
        weight = parameters.gravity * mass
        weight = weight + emerged_weight(
            parameters.gravity, parameters.surge_mass, glider, a
        )
        held = -parameters.drag * drag * jnp.abs(glider.surge)
        wrong = BodyAxes(*ned_to_body(a, zero, zero, weight), *moments)
        held = BodyAxes(
            held * glider.surge,
            held * glider.sway,
            held * glider.heave,
            zero,
            zero,
            zero,
        )
        force = self.model.force(glider, a, command) + wrong + held
        turned = force / parameters.inertia()
        still = jnp.zeros(len(_EXCESS) + 1, mean.dtype)
        _, _, *rates = kinematics(glider, a)
        moved = jnp.stack([*rates, *turned.fields()])
        return jnp.concatenate([moved, still])


def _shown(covariance: Array, n: int) -> tuple[Array, Scalar]:
    """P h and hᵀ P h of a reading: of the depth, the sensor's zero is in it."""
    column = covariance[:, n]
    if n > 0:
        return column, column[n]
    column = column + covariance[:, _ZERO]
    return column, column[n] + column[_ZERO]


def _glider(mean: Array) -> GliderState:
    """The state that a mean stands for, north and east left at zero."""
    return GliderState.at_rest(
        north=jnp.zeros_like(mean[0]),
        east=jnp.zeros_like(mean[0]),
        **{name: mean[n] for n, name in enumerate(STATES)},
    )
