"""The closed loop linearised about the straight glides that a task asks for.

A second of ticks maps the state of everything that remembers (glider, actuators,
law and observer) to the next. Around a steady glide in calm water this map's derivative
has eigenvalues μ, and the loop moves with the rates s = ln μ/(1 s): it is stable where
all real parts are negative. Of a law that runs less often the map is over its cycle:
within one it steers nothing. Where the glider is, and how far the ramp of the depth has
come, counts for nothing; nor do sensors and estimator, the law is told its state.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from jaxglider.core.kept.programs import kept
from jaxglider.environment.disturbances import Calm
from jaxglider.guidance import AttitudeSchedule, Schedule
from jaxglider.guidance.yo import Yo
from jaxglider.signals import BodyAxes, zeros
from jaxglider.simulation.checks.half_yo import HeldHalf, half_glides, longest_stay
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import with_ticks
from jaxglider.simulation.tick import Carry, TickInput
from jaxglider.trim.steady_motion import Target, steady_motion

SETTLING = 120.0
"""Time that law and observer are given to come to rest on the glide [s]."""
DEEP = 500.0
"""Depth that the glide begins at [m], far from surface and bottom."""
LONG = 1000.0
"""Time [s] in which a motion that grows e-fold does no harm: no glide lasts as long."""
NO_WAY = 0.02
"""Speed through the water that counts as none [m/s]."""
SELDOM = 0.5
"""Time between commands [s] from which on it may be what a law is lost by."""
USUAL_ANGLE = round(math.radians(26.0), 9)
"""Gliding angle of most missions of Slocums [rad], rounded as those of tasks are."""
_NEUTRAL, _DEAD, _SMALL = 1e-6, 1e-6, 1e-2
"""Modulus of a rate [1/s] that counts as none, as the place of the glider has; factor
of a motion that has died; and size of a number that a difference is relative to."""


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
        """Largest real part [1/s]: negative if the loop is stable.

        Without any rate every motion has died within the law's cycle.
        """
        return self.rates[0].real if self.rates else -math.inf

    @property
    def stable(self) -> bool:
        """Whether no motion grows e-fold within `LONG`."""
        return self.growth < 1.0 / LONG

    def text(self) -> str:
        """A line that says what the glide is and how the loop behaves on it."""
        if not self.rates:
            return f"{self.glide.text()}: every motion dies within the law's cycle"
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

    Those of a yo are its way down and its way up.

    Where all are steeper than gliders usually fly, that glide as well: gains are not
    used on the task alone that they were made for.

    Args:
        loop: closed loop; a reference without gliding angles has none.
    """
    reference = loop.scenario.reference
    if isinstance(reference, Yo):
        return tuple(Glide(*one) for one in half_glides(loop.scenario))
    schedule = getattr(reference, "schedule", getattr(reference, "vertical", None))
    if not isinstance(schedule, Schedule):
        return ()
    flown = {
        Glide(round(float(angle), 9), float(rate))
        for angle, rate in zip(schedule.gliding_angle, schedule.depth_rate, strict=True)
        if float(angle) * float(rate) < 0.0
    }
    if flown and min(abs(glide.angle) for glide in flown) > USUAL_ANGLE:
        flown.add(Glide(-USUAL_ANGLE, max(abs(glide.depth_rate) for glide in flown)))
    both = flown | {glide.mirrored() for glide in flown}
    return tuple(sorted(both, key=lambda glide: glide.angle))


def loop_modes(loop: ClosedLoop, glides: tuple[Glide, ...]) -> list[LoopModes]:
    """The natural motions of a closed loop on each of some glides.

    By central differences of the map over a second, or over the law's cycle, one
    program without a derivative, in double precision whatever the loop's: rates are
    right to 1e-6 1/s and better.

    Args:
        loop: closed loop in any task; it is put on the glides in calm water.
        glides: straight glides.
    """
    if not glides:
        return []
    clock = loop.scenario.clock
    dt = float(clock.dt)
    # Of one tick, so that its length is no part of the program.
    loop = with_ticks(loop, 1)
    settling = round(SETTLING / dt)
    second = max(round(max(1.0, float(loop.controller.cycle_time())) / dt), 1)
    modes = []
    with jax.enable_x64(True):
        loop = jax.tree.map(_double, loop)
        for glide in glides:
            still = _on_glide(loop, glide)
            derivative = _derivative(still, settling, second)
            modes.append(LoopModes(glide, _rates(derivative, second * dt)))
    return modes


def surface_warning(loop: ClosedLoop) -> str | None:
    """A warning on a law that is lost where the glider makes no way, at the surface.

    There neither wings nor fins damp what it does. As a model serves the glide of a
    dive at next to no speed.

    Args:
        loop: closed loop with concrete numbers; only a yo stays at the surface.
    """
    yo, glides = loop.scenario.reference, glides_of(loop)
    stay = longest_stay(yo) if isinstance(yo, Yo) else 0.0
    if not stay or not glides:
        return None
    angle = glides[0].angle
    slow = Glide(angle, -NO_WAY * math.sin(angle))
    (modes,) = loop_modes(loop, (slow,))
    if not modes.growth * stay > 1.0:
        return None
    return (
        "the loop is NOT stable at the surface, where the glider makes no way and next "
        f"to nothing damps it; a stay lasts up to {stay:.4g} s."
    )


def lost(loop: ClosedLoop) -> list[str]:
    """Sentences on the parts of a task in which a loop is not stable; none if it is.

    Args:
        loop: closed loop with concrete numbers.
    """
    modes = loop_modes(loop, glides_of(loop))
    growing = [] if all(one.stable for one in modes) else [statement(modes)]
    at_surface = surface_warning(loop)
    found = [*growing, *([at_surface] if at_surface else [])]
    every = max(float(loop.scenario.clock.dt), float(loop.controller.cycle_time()))
    if found and every >= SELDOM:
        found[-1] += (
            f" The law runs every {every:.3g} s: a shorter tick (period_s or dt_s of "
            "clock) or gentler gains may hold it."
        )
    return found


def statement(modes: Sequence[LoopModes]) -> str:
    """Whether a loop is stable on its glides, in a sentence or two.

    Args:
        modes: natural motions on each glide.
    """
    growing = [one.text() for one in modes if not one.stable]
    if growing:
        return f"the loop is NOT stable: {'; '.join(growing)}."
    slowest = max(modes, key=lambda one: one.growth)
    return (
        f"the loop is stable on {len(modes)} straight glides, dives and climbs; "
        f"{slowest.text()}."
    )


def _double(leaf: Any) -> Any:
    """A leaf in double precision; whole numbers and what is no array as they are."""
    if not eqx.is_inexact_array(leaf):
        return leaf
    return jnp.asarray(np.asarray(leaf, np.float64))


def _rates(derivative: np.ndarray, span: float) -> tuple[complex, ...]:
    """The rates of a map over a span [s] whose derivative is known."""
    if not np.all(np.isfinite(derivative)):
        return (complex(math.nan),)
    factors = np.linalg.eigvals(derivative)
    # What has died within the span has no rate that could be told.
    rates = np.log(factors[np.abs(factors) > _DEAD].astype(complex)) / span
    moving = rates[(np.abs(rates) > _NEUTRAL) & (rates.imag >= 0.0)]
    return tuple(complex(rate) for rate in sorted(moving, key=lambda s: -s.real))


def _on_glide(loop: ClosedLoop, glide: Glide) -> ClosedLoop:
    """The same law on one straight glide in calm water, begun at its trim.

    It is told its state: what sensors show is no smooth function of it.
    """
    angle, rate, speed = (
        jnp.asarray(x) for x in (glide.angle, glide.depth_rate, glide.speed)
    )
    wanted = Target(speed=speed, glide_angle=angle, turn_rate=0.0 * angle)
    motion = _steady_motion(loop.scenario.plant, wanted)
    trim = motion.state
    schedule = Schedule(
        start=jnp.zeros(1),
        gliding_angle=angle[None],
        heading=jnp.zeros(1),
        depth_rate=rate[None],
        initial_depth=jnp.asarray(DEEP),
    )
    asked = loop.scenario.reference
    scenario = dataclasses.replace(
        loop.scenario,
        reference=HeldHalf.of(asked, glide.angle, motion)
        if isinstance(asked, Yo)
        else AttitudeSchedule(schedule),
        disturbance=Calm(),
        initial_state=dataclasses.replace(trim, depth=trim.depth + DEEP),
        sensors=None,
        instruments=None,
        water=None,
        seabed=None,
    )
    return dataclasses.replace(loop, scenario=scenario, estimator=None)


_steady_motion = kept(steady_motion)


def _derivative(
    loop: ClosedLoop, settling: int, second: int
) -> Float[np.ndarray, "m m"]:
    """The derivative of the map over `second` ticks, once at rest after `settling`."""
    flat, _ = ravel_pytree(_memory(loop.init()))
    size = flat.size
    step = np.finfo(flat.dtype).eps ** (1.0 / 3.0)
    rows = jnp.broadcast_to(flat, (2 * size, size))
    # These numbers are traced: one program settles and takes the difference.
    settle, differ = jnp.asarray([(1, 0, settling), (2 * size, settling, second)])
    middle = np.asarray(_advanced(loop, rows, settle)[0], np.float64)
    steps = step * np.maximum(np.abs(middle), _SMALL)
    ends = np.concatenate([middle + np.diag(steps), middle - np.diag(steps)])
    moved = _advanced(loop, jnp.asarray(ends, flat.dtype), differ)
    ahead, behind = np.split(np.asarray(moved, np.float64), 2)
    return ((ahead - behind) / (2.0 * steps[:, None])).T


@kept
def _advanced(
    loop: ClosedLoop, rows: Float[Array, "k m"], span: Int[Array, "3"]
) -> Float[Array, "k m"]:
    """The memory of the first rows some ticks later: how many rows, since which, ticks.

    One row after the other: only one has the thousands of ticks to fly in which a loop
    settles, and a program of one row compiles faster than one of lanes.
    """
    count, first, ticks = span
    begin = loop.init()
    _, unflat = ravel_pytree(_memory(begin))
    calm = zeros(BodyAxes, begin.state.surge)

    def one(row: Array) -> Array:
        def tick(number: Array, memory: Any) -> Any:
            now = (first + number) * loop.scenario.clock.dt
            plan = loop.plan(now[None], jax.tree.map(lambda x: x[None], calm), None)
            inputs = TickInput(jax.tree.map(lambda x: x[0], plan), calm, None)
            names = ("state", "held", "controller", "observer")
            carry = dataclasses.replace(begin, **dict(zip(names, memory, strict=True)))
            return _memory(loop.tick(carry, inputs)[0])

        return ravel_pytree(jax.lax.fori_loop(0, ticks, tick, unflat(row)))[0]

    def advance(number: Array, done: Array) -> Array:
        return done.at[number].set(one(done[number]))

    return jax.lax.fori_loop(0, count, advance, rows)


def _memory(carry: Carry) -> tuple[Any, ...]:
    return carry.state, carry.held, carry.controller, carry.observer
