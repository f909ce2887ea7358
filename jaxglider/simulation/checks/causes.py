"""Likely causes of a failure: a list of rules, each a function of the flight before.

A rule gives a sentence where it has something to say, and None where not. The list is
in the order of what explains most; a new rule is a function and its name in `RULES`.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.signals import (
    COMMAND_UNITS,
    BodyAxes,
    Command,
    GliderState,
    map_fields,
    zeros,
)
from jaxglider.simulation.checks.law_rates import fastest_rate
from jaxglider.simulation.checks.past import WINDOW, Past, through_water
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.trim.linear_model import STATES

STEP_LIMIT = 2.5
"""Product of step and fastest rate from which on a Runge-Kutta step of order four
amplifies a decaying motion: 2.79 on the real axis, 2.83 on the imaginary one."""
LAW_LIMIT = 2.0
"""Product of tick and rate of a law from which on its variables grow by themselves."""
ADRIFT, SOON, FAST, TORRENT = 0.05, 300.0, 2.0, 3.0
"""Flow at the start [m/s] that counts, time [s] in which it shows, the fastest start
through the water that a glider might have, and the fastest current of a sea [m/s]."""
STALL, SHARE, LONG = math.radians(25.0), 0.9, 5.0
"""Angle of attack of a stall [rad], share of the time that counts as all of it, and
time [s] that an actuator has to stand at its limit to be named."""
_LIVELY = 5.0
"""Speed [m/s] and rates [rad/s] beyond which a failure has begun already."""


def non_finite_command(past: Past) -> str | None:
    """A law whose command is no number though all that it sees is one."""
    name = past.culprit.name
    if not name.endswith(" wanted"):
        return None
    return (
        f"the law asked for a {name.removesuffix(' wanted').replace('_', ' ')} of "
        f"{past.culprit.value:g} while the state was still finite: look at its gains, "
        "or, in a law of your own, at a division by zero or a root of zero"
    )


def torrent(past: Past) -> str | None:
    """A current that no sea has."""
    water = past.loop.scenario.water
    if water is None or water.current is None:
        return None
    where, when = past.last_state().depth, jnp.asarray(past.culprit.time)
    north, east = water.current.velocity(jnp.asarray(where), when)
    speed = math.hypot(float(north), float(east))
    if not speed > TORRENT:
        return None
    return (
        f"the current of {speed:.3g} m/s is more than any sea has, and than any glider "
        "makes way against: see water.current, in m/s (1 cm/s is 0.01)"
    )


def adrift_at_start(past: Past) -> str | None:
    """A start at rest over ground in a current, which flows past the glider."""
    current = past.loop.scenario.water and past.loop.scenario.water.current
    if current is None or past.culprit.time > SOON:
        return None
    ahead, aside, down = start_through_water(past.loop)
    flow = math.hypot(ahead, aside, down)
    if flow < ADRIFT or abs(math.atan2(math.hypot(aside, down), ahead)) < STALL:
        return None
    return (
        f"the start is at rest over ground in a current: the water meets the glider at "
        f"{flow:.3g} m/s {_side(ahead, aside)}. Give "
        "initial_state.surge_through_water_m_s = 0.0 to start drifting with it"
    )


def fast_at_start(past: Past) -> str | None:
    """A start through the water at a speed that no glider has."""
    speed = math.hypot(*start_through_water(past.loop))
    if speed < FAST or past.culprit.time > SOON:
        return None
    return (
        f"the glider starts at {speed:.3g} m/s through the water; gliders make 0.2 to "
        "0.5 m/s: see surge_m_s, sway_m_s and heave_m_s of initial_state, and "
        "water.current"
    )


def step_too_long(past: Past) -> str | None:
    """An integration step that is too long for the fastest motion of the glider."""
    clock = past.loop.scenario.clock
    step = float(clock.dt) / clock.substeps
    rates = plant_rates(past.loop, _samples(past))
    rate = next((rate for rate in rates if step * rate > STEP_LIMIT), None)
    if rate is None:
        return None
    return (
        f"the integration step of {step:.3g} s is too long: the fastest motion of the "
        f"glider takes {1.0 / rate:.3g} s, and steps up to {STEP_LIMIT / rate:.2g} s "
        "are stable. Shorten clock.dt_s, or raise clock.substeps"
    )


def tick_too_long(past: Past) -> str | None:
    """A tick that is too long for the law."""
    dt, rate = float(past.loop.scenario.clock.dt), fastest_rate(past.loop.controller)
    if rate is None or not dt * float(rate) > LAW_LIMIT:
        return None
    return (
        f"the tick of {dt:.3g} s is too long for the law, whose own variables move in "
        f"{1.0 / float(rate):.2g} s: shorten clock.dt_s, or lower the gains"
    )


def rolled_over(past: Past) -> str | None:
    """A roll beyond 90 degrees."""
    roll = np.abs(np.asarray(past.ticks.state.roll, np.float64))
    if not past.count or not roll.max() > math.pi / 2:
        return None
    at = past.time[np.argmax(roll > math.pi / 2)]
    return (
        f"the glider rolled over: past 90 deg at {at:.4g} s, up to "
        f"{math.degrees(roll.max()):.0f} deg"
    )


def on_its_nose(past: Past) -> str | None:
    """A pitch near the vertical, where heading and roll are no longer defined."""
    pitch = np.abs(np.asarray(past.ticks.state.pitch, np.float64))
    steep = math.radians(80.0)
    if not past.count or not pitch.max() > steep:
        return None
    at = past.time[np.argmax(pitch > steep)]
    return f"the glider stood on its nose or tail: pitch past 80 deg at {at:.4g} s"


def stalled(past: Past) -> str | None:
    """An angle of attack at which the lift of no wing is linear."""
    ahead, _, down = past.through_water[:, -WINDOW:]
    attack = np.abs(np.arctan2(down, ahead))
    if not attack.size or np.mean(attack > STALL) < SHARE:
        return None
    lasted = past.time[-1] - past.time[-attack.size]
    return (
        f"the glider was stalled: angle of attack {math.degrees(attack[-1]):.0f} deg, "
        f"beyond 25 deg for the last {lasted:.3g} s; its forces are not known there"
    )


def actuator_at_limit(past: Past) -> str | None:
    """Actuators that stood at their limits, or were too slow, until the failure."""
    held = [text for name in COMMAND_UNITS for text in _strained(past, name)]
    return "; ".join(held) or None


Rule = Callable[[Past], str | None]
RULES: tuple[Rule, ...] = (
    non_finite_command,
    torrent,
    adrift_at_start,
    fast_at_start,
    step_too_long,
    tick_too_long,
    rolled_over,
    on_its_nose,
    stalled,
    actuator_at_limit,
)
"""Rules in the order of what explains most."""
OF_THE_TASK: tuple[Rule, ...] = (torrent, adrift_at_start, fast_at_start, step_too_long)
"""Rules on what no gains can mend."""


def start_through_water(loop: ClosedLoop) -> tuple[float, float, float]:
    """Velocity through the water at the start: forward, to starboard, down [m/s].

    Args:
        loop: closed loop.
    """
    start = loop.scenario.initial_state
    rows = jax.tree.map(lambda x: jnp.asarray(x)[None], start)
    ahead, aside, down = through_water(loop, rows, np.zeros(1))[:, 0]
    return float(ahead), float(aside), float(down)


def plant_rates(
    loop: ClosedLoop, states: list[tuple[GliderState, Command[np.ndarray]]]
) -> list[float]:
    """Modulus of the fastest natural motion of a glider at some states [1/s].

    Of the motions that decay: one that grows is no matter of the step.

    Args:
        loop: closed loop whose plant it is; the water counts as at rest.
        states: states and the commands held there.
    """
    rates = []
    for state, command in states:
        matrix = np.asarray(_jacobian(loop.scenario.plant, state, command))
        if np.all(np.isfinite(matrix)):
            values = np.linalg.eigvals(matrix)
            rates.append(float(np.abs(values[values.real <= 0.0]).max(initial=0.0)))
    return rates


@eqx.filter_jit
def _jacobian(
    plant: eqx.Module, state: GliderState, command: Command[np.ndarray]
) -> jax.Array:
    """Derivative of the rates of attitude and velocity by themselves."""
    calm = zeros(BodyAxes, state.surge)

    def rates(row: jax.Array) -> jax.Array:
        at = eqx.tree_at(
            lambda s: [getattr(s, name) for name in STATES], state, list(row)
        )
        rate = plant.derivative(at, command, calm)  # type: ignore[attr-defined]
        return jnp.stack([getattr(rate, name) for name in STATES])

    row = jnp.stack([jnp.asarray(getattr(state, name)) for name in STATES])
    return jax.jacfwd(rates)(row)


def _samples(past: Past) -> list[tuple[GliderState, Command[np.ndarray]]]:
    """The start and some of the last states that are not wild yet."""
    start = map_fields(jnp.asarray, past.loop.scenario.initial_state)
    none = zeros(Command, start.surge)
    found = [(start, none)]
    lively = np.max(np.abs(past.through_water), axis=0, initial=0.0)
    tame = np.flatnonzero(lively < _LIVELY)[-WINDOW:]
    for n in tame[:: max(len(tame) // 8, 1)]:
        found.append(
            tuple(
                jax.tree.map(lambda x, n=n: jnp.asarray(np.asarray(x)[n]), part)
                for part in (past.ticks.state, past.ticks.applied)
            )
        )
    return found


def _side(ahead: float, aside: float) -> str:
    """Side that the water comes from."""
    if abs(ahead) > abs(aside):
        return "from ahead" if ahead > 0.0 else "from behind"
    return "from starboard" if aside > 0.0 else "from port"


def _strained(past: Past, name: str) -> list[str]:
    """Shortcomings of one actuator until the failure, and how long they lasted."""
    actuator = getattr(past.loop.scenario.actuators, name)
    applied = np.asarray(getattr(past.ticks.applied, name), np.float64)
    wanted = np.asarray(getattr(past.ticks.wanted, name), np.float64)
    limit, unit = float(actuator.limit), COMMAND_UNITS[name]
    for flags, text in (
        (np.abs(applied) >= 0.999 * limit, f"stood at its limit of {limit:.4g} {unit}"),
        (np.abs(wanted - applied) > 1e-9 + 0.01 * limit, "was behind its command"),
    ):
        lasted = _last(flags) * float(past.loop.scenario.clock.dt)
        if lasted >= min(LONG, 0.5 * past.culprit.time) > 0.0:
            words = name.replace("_", " ")
            return [f"the {words} {text} for the last {lasted:.3g} s"]
    return []


def _last(flags: np.ndarray) -> int:
    """Number of flags at the end that are set without a break."""
    unset = np.flatnonzero(~flags[::-1])
    return int(unset[0]) if unset.size else len(flags)
