"""The motion of a glider in the water and with the ballast of a record.

| kind | given | predicted |
|---|---|---|
| steady | pitch | depth rate and speed of the glide in balance |
| driven | pitch | the same with the masses that are to be accelerated |
| closed | moving mass | pitch, roll, turn rate, depth rate and speed: the full plant |

Predictions are those of the instruments: the pitch as its sensor would record it, rates
smoothed as the record's are.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.rotations import body_to_ned, euler_rates, ned_to_body
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.vehicle.hydrodynamics import flow_frame_hydrodynamics
from tuning.identification.glider import IdentifiedGlider
from tuning.identification.record.slopes import kernel
from tuning.identification.windows import Windows

Prediction = dict[str, jax.Array]
"""Arrays of the windows' shape by channel."""
DRIFT = 0.05
"""Speed [m/s] with which a glider is taken to leave the surface."""
STEEPEST = 1.2
"""Largest pitch [rad] that a run of the full plant starts from, or at the surface."""
_SHALLOWEST = 0.1
"""Pitch [rad] below which no glide is in balance, and none is sought."""


def predict(kind: str, glider: IdentifiedGlider, windows: Windows) -> Prediction:
    """Predicted channels of all windows.

    Args:
        kind: kind of the fit.
        glider: the glider.
        windows: inputs from the record.
    """
    return _KINDS[kind](glider, windows)


def glide(
    glider: IdentifiedGlider, pitch: jax.Array, heaviness: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Surge and heave [m/s] of the glide in balance at a pitch.

    The angle of attack solves D(α) + L(α) tan(θ − α) = 0 (Newton, from small angles);
    V² = m_b g sin(α − θ)/D. Zero where the pitch is too shallow or of the wrong sign.

    Args:
        glider: the glider.
        pitch: θ [rad].
        heaviness: m_b [kg], positive sinks.
    """
    c = glider.parameters
    safe = jnp.where(jnp.abs(pitch) > _SHALLOWEST, pitch, _SHALLOWEST)

    def balance(alpha: jax.Array) -> jax.Array:
        drag = c.drag + glider.body.induced_drag * alpha * alpha
        lift = c.lift_offset + c.lift_slope * alpha
        return drag + lift * jnp.tan(safe - alpha)

    alpha = jnp.clip(-c.drag / (c.lift_slope * jnp.tan(safe)), -0.2, 0.2)
    for _ in range(6):
        value, slope = jax.jvp(balance, (alpha,), (jnp.ones_like(alpha),))
        alpha = jnp.clip(alpha - value / slope, -0.3, 0.3)
    drag = c.drag + glider.body.induced_drag * alpha * alpha
    squared = heaviness * c.gravity * jnp.sin(alpha - safe) / drag
    flies = (squared > 1e-6) & (jnp.abs(pitch) > _SHALLOWEST)
    speed = jnp.where(flies, jnp.sqrt(jnp.where(flies, squared, 1.0)), 0.0)
    return speed * jnp.cos(alpha), speed * jnp.sin(alpha)


def _heaviness(glider: IdentifiedGlider, w: Windows) -> jax.Array:
    excess = glider.excess(w.pressure, w.density, w.temperature)
    return excess - w.density * w.ballast


def _late(values: jax.Array, steps: jax.Array) -> jax.Array:
    """Rows that come late by some steps, linear in between."""
    places = jnp.arange(values.shape[1], dtype=values.dtype)
    return jax.vmap(lambda row: jnp.interp(places - steps, places, row))(values)


def _acting(glider: IdentifiedGlider, windows: Windows) -> Windows:
    """The windows with their actuators as late as they act."""
    steps = glider.record.actuator_lag / windows.dt
    return dataclasses.replace(
        windows,
        ballast=_late(windows.ballast, steps),
        mass_position=_late(windows.mass_position, steps),
        mass_angle=_late(windows.mass_angle, steps),
    )


def _smooth(windows: Windows, rate: jax.Array) -> jax.Array:
    weights = jnp.asarray(kernel(windows.half_width))
    return jax.vmap(lambda row: jnp.convolve(row, weights, mode="same"))(rate)


def _steady(glider: IdentifiedGlider, windows: Windows) -> Prediction:
    pitch = glider.true_pitch(windows.pitch)
    u, w = glide(glider, pitch, _heaviness(glider, windows))
    rate = w * jnp.cos(pitch) - u * jnp.sin(pitch)
    return {"depth_rate": _smooth(windows, rate), "speed": jnp.sqrt(u * u + w * w)}


def _driven(glider: IdentifiedGlider, windows: Windows) -> Prediction:
    """u' and w' of the body in the vertical plane, the pitch as it was recorded."""
    windows = _acting(glider, windows)
    pitch = glider.true_pitch(windows.pitch)
    turning = glider.record.pitch_scale * windows.pitch_rate
    heavy = _heaviness(glider, windows)
    p = glider.parameters

    def derivative(state: tuple, given: tuple) -> tuple:
        (u, w), (theta, rate, mass, _) = state, given
        zero = jnp.zeros_like(u)
        force = flow_frame_hydrodynamics(
            p, glider.body.induced_drag, BodyAxes(u, zero, w, zero, zero, zero)
        )
        weight = p.gravity * mass
        surge = force.surge - weight * jnp.sin(theta) - p.heave_mass * w * rate
        heave = force.heave + weight * jnp.cos(theta) + p.surge_mass * u * rate
        return surge / p.surge_mass, heave / p.heave_mass

    def afloat(state: tuple, given: tuple) -> tuple:
        at_surface = given[3] > 0.5
        u, w = state
        return jnp.where(at_surface, DRIFT, u), jnp.where(at_surface, 0.0, w)

    inputs = (pitch, turning, heavy, windows.afloat)
    first = glide(glider, pitch[:, 0], heavy[:, 0])
    u, w = _integrate(derivative, afloat, first, inputs, windows)
    rate = w * jnp.cos(pitch) - u * jnp.sin(pitch)
    speed = jnp.sqrt(u * u + w * w + 1e-12)
    return {"depth_rate": _smooth(windows, rate), "speed": speed}


def _closed(glider: IdentifiedGlider, windows: Windows) -> Prediction:
    """The full plant under its recorded actuators; the pitch is given at the start."""
    plant, r = glider.plant(), glider.record
    windows = _acting(glider, windows)
    excess = glider.excess(windows.pressure, windows.density, windows.temperature)
    position = windows.mass_position - r.position_offset
    angle = windows.mass_angle + r.angle_offset
    pitch = jnp.clip(glider.true_pitch(windows.pitch), -STEEPEST, STEEPEST)
    roll = windows.roll + r.roll_offset

    def derivative(state: GliderState, given: tuple) -> GliderState:
        mass, pumped, place, turned, _, _ = given
        zero = jnp.zeros_like(mass)
        pull = ned_to_body(
            state.attitude(), zero, zero, glider.parameters.gravity * mass
        )
        return plant.derivative(
            state,
            Command(-pumped, place, turned),
            BodyAxes(*pull, zero, zero, zero),
        )

    def afloat(state: GliderState, given: tuple) -> GliderState:
        at_surface = given[4] > 0.5
        rest = GliderState.at_rest(pitch=given[5], heading=state.heading, surge=DRIFT)
        return jax.tree.map(
            lambda calm, moved: jnp.where(at_surface, calm, moved), rest, state
        )

    inputs = (
        excess,
        windows.density * windows.ballast,
        position,
        angle,
        windows.afloat,
        pitch,
    )
    u, w = glide(glider, pitch[:, 0], _heaviness(glider, windows)[:, 0])
    zero = jnp.zeros_like(u)
    first = GliderState(
        *(zero, zero, zero, roll[:, 0], pitch[:, 0], zero, u, zero, w, zero, zero, zero)
    )
    state = _integrate(derivative, afloat, first, inputs, windows)
    sinking, turning = jax.vmap(jax.vmap(_rates))(state)
    squared = state.surge**2 + state.sway**2 + state.heave**2
    return {
        "depth_rate": _smooth(windows, sinking),
        "speed": jnp.sqrt(squared + 1e-12),
        "pitch": glider.sensed_pitch(state.pitch),
        "roll": state.roll - r.roll_offset,
        "turn_rate": _smooth(windows, turning),
    }


def _rates(state: GliderState) -> tuple[Scalar, Scalar]:
    """Rates of depth [m/s] and heading [rad/s]."""
    a = state.attitude()
    _, _, sinking = body_to_ned(a, state.surge, state.sway, state.heave)
    _, _, turning = euler_rates(a, state.roll_rate, state.pitch_rate, state.yaw_rate)
    return sinking, turning


def _integrate(
    derivative: Callable,
    afloat: Callable,
    first: Any,
    inputs: tuple,
    windows: Windows,
) -> Any:
    """States at all samples, inputs linear in between, by classical Runge-Kutta."""
    parts = max(1, math.ceil(windows.dt / windows.longest))
    step = windows.dt / parts

    def tick(state: Any, ends: tuple) -> tuple:
        begin, end = ends

        def part(number: jax.Array, at: Any) -> Any:
            def slope(s: Any, share: jax.Array) -> Any:
                where = (number + share) / parts
                given = jax.tree.map(lambda a, b: a + where * (b - a), begin, end)
                return derivative(s, given)

            return runge_kutta_step(RK4, slope, at, jnp.asarray(step))

        if parts == 1:
            state = part(jnp.asarray(0.0), state)
        else:
            state = jax.lax.fori_loop(
                0, parts, lambda k, s: part(k.astype(float), s), state
            )
        state = jax.tree.map(lambda x: jnp.clip(x, -50.0, 50.0), state)
        state = afloat(state, end)
        return state, state

    begin = jax.tree.map(lambda x: x[:, :-1].T, inputs)
    end = jax.tree.map(lambda x: x[:, 1:].T, inputs)
    start = jax.vmap(afloat)(first, jax.tree.map(lambda x: x[:, 0], inputs))
    states: Any
    _, states = jax.lax.scan(jax.vmap(tick), start, (begin, end))
    return jax.tree.map(
        lambda one, rest: jnp.concatenate([one[:, None], rest.T], axis=1), start, states
    )


_KINDS = {"steady": _steady, "driven": _driven, "closed": _closed}
KINDS = tuple(_KINDS)
"""Names of the fits, the lightest first."""
