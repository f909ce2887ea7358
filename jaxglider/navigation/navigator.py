"""The navigator: sensors, estimator and reckoning, one tick after the other."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.rotations import body_to_ned
from jaxglider.environment.water import through_water
from jaxglider.navigation.errors import NavigationSums, add_errors, empty_navigation
from jaxglider.navigation.estimator import AbstractEstimator, Moves
from jaxglider.navigation.reckoning import Reckoning, ReckoningState
from jaxglider.navigation.sensing.positioning import Fix
from jaxglider.navigation.sensing.readings import (
    Instruments,
    InstrumentSamples,
    InstrumentState,
    Sensed,
)
from jaxglider.signals import GliderState, Measurement


class NavigatorState(eqx.Module):
    """Knowledge on board between two ticks, and the sums of its errors.

    Attributes:
        instruments: state of the sensors.
        estimator: state of the estimator.
        reckoning: belief of place.
        altitude: height over the bottom that is believed [m], infinite for none; None
            without an altimeter or a bottom.
        fix: position by satellite of the last tick; None without a receiver.
        sums: running sums of the errors.
    """

    instruments: InstrumentState
    estimator: Any
    reckoning: ReckoningState
    altitude: Scalar | None
    fix: Fix | None
    sums: NavigationSums


class OnBoard(eqx.Module):
    """The record of what is known on board.

    Attributes:
        estimate: estimated state, north and east reckoned.
        shown: depth, roll, pitch and heading as the sensors show them [m, rad].
        current: current that is reckoned with, north and east [m/s].
        fix: fix that came in the last tick, north and east [m]; NaN where none did.
    """

    estimate: GliderState
    shown: Sensed[Scalar]
    current: tuple[Scalar, Scalar]
    fix: tuple[Scalar, Scalar]


class Surroundings(NamedTuple):
    """The truth that sensors are in, at the end of a tick.

    Attributes:
        state: true state.
        height: true height over the bottom [m], or None without one.
        current: velocity of the water, north and east [m/s].
    """

    state: GliderState
    height: Scalar | None
    current: tuple[Scalar, Scalar]


class Navigator(eqx.Module):
    """Sensors, estimator and reckoning of a glider.

    Attributes:
        instruments: sensors.
        estimator: estimator.
        reckoning: dead reckoning.
    """

    instruments: Instruments
    estimator: AbstractEstimator
    reckoning: Reckoning

    def init(self, state: GliderState, height: Scalar | None) -> NavigatorState:
        """Knowledge on deck.

        Args:
            state: true state at the start.
            height: true height over the bottom [m], or None without one.
        """
        instruments = self.instruments.init(state)
        seen = self.instruments.altimeter is not None and height is not None
        return NavigatorState(
            instruments=instruments,
            estimator=self.estimator.init(state),
            reckoning=self.reckoning.init(state),
            altitude=jnp.full_like(state.depth, jnp.inf) if seen else None,
            fix=None if self.instruments.positioning is None else _no_fix(state),
            sums=empty_navigation(state.depth),
        )

    def estimate(self, known: NavigatorState) -> GliderState:
        """The state that laws are given: estimated, at the reckoned place."""
        north, east = known.reckoning.place
        estimate = self.estimator.estimate(known.estimator)
        return dataclasses.replace(estimate, north=north, east=east)

    def measurement(self, known: NavigatorState, truth: Measurement) -> Measurement:
        """All that a controller may know about the glider.

        Args:
            known: knowledge on board.
            truth: measurement of perfect sensors.
        """
        state = self.estimate(known)
        aground = None if truth.altitude is None else truth.altitude <= 0.0
        return dataclasses.replace(
            truth,
            state=state,
            attitude=state.attitude(),
            altitude=known.altitude,
            current=known.reckoning.current,
            aground=aground,
        )

    def record(self, known: NavigatorState) -> OnBoard:
        """Knowledge on board, for a trajectory."""
        fix, nothing = known.fix, known.reckoning.place[0] * jnp.nan
        where = (nothing, nothing)
        if fix is not None:
            north, east = (
                jnp.where(fix.fresh, x, nothing) for x in (fix.north, fix.east)
            )
            where = north, east
        return OnBoard(
            estimate=self.estimate(known),
            shown=known.instruments.shown,
            current=known.reckoning.current,
            fix=where,
        )

    @jax.named_scope("navigation")
    def step(
        self,
        known: NavigatorState,
        around: Surroundings,
        measured: GliderState,
        samples: InstrumentSamples,
        moves: Moves,
        since_inflection: Scalar,
        under_way: Scalar,
        dt: Scalar,
    ) -> NavigatorState:
        """Knowledge one tick later.

        Args:
            known: knowledge at the start of the tick.
            around: truth at its end.
            measured: state that the instruments are shown: the true one, or one with
                errors of its own.
            samples: row of the samples at its end.
            moves: positions of the actuators over the tick.
            since_inflection: time since the last inflection or segment [s].
            under_way: number, 1 under water and 0 at the surface.
            dt: tick [s].
        """
        readings, instruments = self.instruments.step(
            known.instruments, measured, around.height, samples, dt
        )
        relative = through_water(around.state, around.current)
        estimator = self.estimator.step(known.estimator, readings, moves, relative, dt)
        estimate = self.estimator.estimate(estimator)
        reckoning = self.reckoning.step(
            known.reckoning, estimate, instruments.shown.depth, readings.fix, dt
        )
        s = around.state
        north, east, _ = body_to_ned(s.attitude(), s.surge, s.sway, s.heave)
        sums = add_errors(
            known.sums,
            relative=relative,
            velocity=(north, east),
            current=around.current,
            estimate=estimate,
            since_inflection=since_inflection,
            under_way=under_way,
            reckoning=(known.reckoning, reckoning),
            dt=dt,
        )
        return NavigatorState(
            instruments=instruments,
            estimator=estimator,
            reckoning=reckoning,
            altitude=readings.altitude,
            fix=readings.fix,
            sums=sums,
        )


def begun(
    navigator: Navigator | None, state: GliderState, height: Scalar | None
) -> Any:
    """Knowledge on deck; None without instruments.

    Args:
        navigator: sensors, estimator and reckoning, or None.
        state: true state at the start.
        height: true height over the bottom [m], or None without one.
    """
    return None if navigator is None else navigator.init(state, height)


def recorded(navigator: Navigator | None, known: Any) -> OnBoard | None:
    """Knowledge on board, for a trajectory; None without instruments.

    Args:
        navigator: sensors, estimator and reckoning, or None.
        known: knowledge on board.
    """
    return None if navigator is None else navigator.record(known)


def _no_fix(state: GliderState) -> Fix:
    return Fix(jnp.asarray(False), state.north, state.east)
