"""The closed loop linearised about the straight glides that a task asks for.

One control tick maps the state of everything that remembers (glider, actuators, law and
observer) to the next. Around a steady glide in calm water its derivative has
eigenvalues μ, and the loop moves with the rates s = ln μ/Δt: it is stable where all
real parts are negative. Where the glider is, and how far the ramp of the depth has
come, counts for nothing.
"""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxglider.core.containers import Scalar
from jaxglider.environment.disturbances import Calm
from jaxglider.guidance import AttitudeSchedule, Schedule
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Clock
from jaxglider.trim.steady_motion import Target, steady_motion

SETTLING = 120.0
"""Time that law and observer are given to come to rest on the glide [s]."""
DEEP = 500.0
"""Depth that the glide begins at [m], far from surface and bottom."""
_NEUTRAL = 1e-6
"""Modulus of a rate [1/s] that counts as none: the place of the glider."""


@dataclasses.dataclass(frozen=True)
class Glide:
    """A straight glide.

    Attributes:
        angle: ξ [rad], negative for a dive.
        depth_rate: Ż [m/s], positive for a dive.
    """

    angle: float
    depth_rate: float

    @property
    def speed(self) -> float:
        """Speed along the path [m/s]."""
        return abs(self.depth_rate / math.sin(self.angle))

    def mirrored(self) -> "Glide":
        """The climb that belongs to a dive, and the other way round."""
        return Glide(-self.angle, -self.depth_rate)

    def text(self) -> str:
        """The glide in words."""
        word = "dive" if self.angle < 0.0 else "climb"
        return (
            f"{word} at {abs(math.degrees(self.angle)):.3g} deg, {self.speed:.3g} m/s"
        )


@dataclasses.dataclass(frozen=True)
class LoopModes:
    """Natural motions of a closed loop on a glide.

    Attributes:
        glide: straight glide that they are about.
        rates: rates s [1/s], the slowest to decay first; of a pair, the one with the
            positive imaginary part.
    """

    glide: Glide
    rates: tuple[complex, ...]

    @property
    def growth(self) -> float:
        """Largest real part [1/s]: negative if the loop is stable."""
        return self.rates[0].real

    @property
    def stable(self) -> bool:
        """Whether every motion decays."""
        return self.growth < 0.0

    def text(self) -> str:
        """A line that says what the glide is and how the loop behaves on it."""
        first = self.rates[0]
        period = ""
        if abs(first.imag) > 0.0:
            period = f" while it swings with {2 * math.pi / abs(first.imag):.3g} s"
        word = "decays" if self.stable else "GROWS"
        if first.real == 0.0 or not math.isfinite(first.real):
            return f"{self.glide.text()}: no verdict"
        return (
            f"{self.glide.text()}: the slowest motion {word} e-fold in "
            f"{1.0 / abs(first.real):.3g} s{period}"
        )


def glides_of(loop: ClosedLoop) -> tuple[Glide, ...]:
    """The straight glides of a loop's task, each as a dive and as a climb.

    Args:
        loop: closed loop; a reference without gliding angles has none.
    """
    reference = loop.scenario.reference
    schedule = getattr(reference, "schedule", getattr(reference, "vertical", None))
    if not isinstance(schedule, Schedule):
        return ()
    flown = {
        Glide(round(float(angle), 9), float(rate))
        for angle, rate in zip(schedule.gliding_angle, schedule.depth_rate, strict=True)
        if float(angle) * float(rate) < 0.0
    }
    both = flown | {glide.mirrored() for glide in flown}
    return tuple(sorted(both, key=lambda glide: glide.angle))


def loop_modes(loop: ClosedLoop, glides: tuple[Glide, ...]) -> list[LoopModes]:
    """The natural motions of a closed loop on each of some glides.

    Worth double precision. One program is compiled for all.

    Args:
        loop: closed loop in any task; it is put on the glides in calm water.
        glides: straight glides.
    """
    if not glides:
        return []
    angles, rates = (
        jnp.asarray([getattr(glide, name) for glide in glides])
        for name in ("angle", "depth_rate")
    )
    clock = loop.scenario.clock
    dt = float(clock.dt)
    clock = Clock(max(round(SETTLING / dt), 1), clock.dt, clock.substeps)
    scenario = dataclasses.replace(loop.scenario, clock=clock)
    loop = dataclasses.replace(loop, scenario=scenario)
    maps = np.asarray(_derivatives(loop, angles, rates), np.float64)
    return [
        LoopModes(glide, _rates(one, dt))
        for glide, one in zip(glides, maps, strict=True)
    ]


def _rates(derivative: np.ndarray, dt: float) -> tuple[complex, ...]:
    if not np.all(np.isfinite(derivative)):
        return (complex(math.nan),)
    factors = np.linalg.eigvals(derivative)
    # What has died within a tick has no rate.
    rates = np.log(factors[np.abs(factors) > 1e-12].astype(complex)) / dt
    moving = rates[(np.abs(rates) > _NEUTRAL) & (rates.imag >= 0.0)]
    return tuple(complex(rate) for rate in sorted(moving, key=lambda s: -s.real))


@eqx.filter_jit
def _derivatives(
    loop: ClosedLoop, angles: Float[Array, " n"], rates: Float[Array, " n"]
) -> Float[Array, "n m m"]:
    """The derivative of one tick on each glide, after it has come to rest."""
    return jax.vmap(lambda angle, rate: _derivative(loop, angle, rate))(angles, rates)


def _derivative(loop: ClosedLoop, angle: Scalar, rate: Scalar) -> Float[Array, "m m"]:
    glide = _on_glide(loop, angle, rate)
    ticks = glide.inputs(glide.scenario.sea(jax.random.key(0)))
    first = glide.init()
    carry, _ = jax.lax.scan(lambda c, x: (glide.tick(c, x)[0], None), first, ticks)
    last = jax.tree.map(lambda x: x[-1], ticks)
    flat, unflat = ravel_pytree(_memory(carry))

    def following(x: Array) -> Array:
        state, held, controller, observer = unflat(x)
        moved = dataclasses.replace(
            carry, state=state, held=held, controller=controller, observer=observer
        )
        return ravel_pytree(_memory(glide.tick(moved, last)[0]))[0]

    columns = jax.lax.map(
        lambda along: jax.jvp(following, (flat,), (along,))[1], jnp.eye(flat.size)
    )
    return columns.T


def _memory(carry: object) -> tuple[object, ...]:
    names = ("state", "held", "controller", "observer")
    return tuple(getattr(carry, name) for name in names)


def _on_glide(loop: ClosedLoop, angle: Scalar, rate: Scalar) -> ClosedLoop:
    """The same law on one straight glide in calm water, begun at its trim."""
    scenario = loop.scenario
    speed = jnp.abs(rate / jnp.sin(angle))
    wanted = Target(speed=speed, glide_angle=angle, turn_rate=0.0 * angle)
    motion = steady_motion(scenario.plant, wanted)
    start = dataclasses.replace(motion.state, depth=motion.state.depth + DEEP)
    schedule = Schedule(
        start=jnp.zeros(1),
        gliding_angle=angle[None],
        heading=jnp.zeros(1),
        depth_rate=rate[None],
        initial_depth=jnp.asarray(DEEP),
    )
    return dataclasses.replace(
        loop,
        scenario=dataclasses.replace(
            scenario,
            reference=AttitudeSchedule(schedule),
            disturbance=Calm(),
            initial_state=start,
            sensors=None,
            water=None,
        ),
    )
