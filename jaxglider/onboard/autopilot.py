"""Autopilot on the vehicle: guidance, observer, law, limits as one pure function.

One call per control tick, `Autopilot.step`, turns a reading of the clock and a
measurement into a command. With sound inputs it does what a closed loop does in
`rollout.ClosedLoop.tick`, command by command; the observer, which there ends a tick,
here begins the next one, because only then is the following measurement known.

Inputs need not be sound. What a tick does about it, and says in its status word:

- A number that is missing (NaN), infinite or out of its range is replaced by the last
  good one. Meanwhile nothing is integrated: controller and observer keep their states.
- Where that lasts longer than `patience`, and before the first complete measurement,
  the actuators go to the safe command. The next complete measurement starts controller
  and observer afresh.
- Mission time follows the clock as long as it runs forward in believable steps; else it
  goes on by Δt at each tick. It never runs back. A clock that was set is believed again
  once it has run steadily for `trust`: mission time jumps forward with it, and goes on
  from where it was if the clock was set back.
- A command that is not finite is replaced by the one held; a state that is not sound,
  by its initial one.
- Whatever happens, commands stay within the actuators' limits.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control.controller import AbstractController
from jaxglider.control.observer import AbstractObserver
from jaxglider.core.containers import Counter, Flag, Scalar
from jaxglider.core.numerics import saturate
from jaxglider.core.rotations import Attitude
from jaxglider.guidance.obedience import informed, obeyed
from jaxglider.guidance.reference import AbstractReference
from jaxglider.onboard.guard import (
    BITS,
    MANY,
    Guard,
    TimeState,
    all_of,
    believed_plan,
    is_within,
    mission_time,
    select,
    sound,
    within,
)
from jaxglider.signals import (
    Command,
    GliderState,
    Measurement,
    Reference,
    map_fields,
    zeros,
)
from jaxglider.simulation.origin import MAP_ZERO, Origin
from jaxglider.vehicle.actuators import Actuator, follow_all


class AutopilotState(eqx.Module):
    """State of the autopilot between two ticks on board.

    Attributes:
        started: a complete measurement has been seen.
        time: reckoning of the mission time.
        silent: ticks since the last complete measurement.
        measured: last good measurement, number by number.
        attitude: sines and cosines of its Euler angles.
        held: positions of the actuators [kg, m, rad].
        planned: last good plan.
        reference: state of the reference.
        controller: state of the controller.
        observer: state of the observer.
    """

    started: Flag
    time: TimeState
    silent: Counter
    measured: GliderState
    attitude: Attitude
    held: Command[Scalar]
    planned: Any
    reference: Any
    controller: Any
    observer: Any


class Autopilot(eqx.Module):
    """Guidance, observer and law with the guard that checks their inputs on board.

    Attributes:
        controller: the law and its gains.
        observer: the disturbance observer.
        reference: the task.
        actuators: limits of the actuators, and a model of where they are.
        dt: control tick [s].
        guard: limits of believable inputs.
        origin: place that measured positions count from here; who exports it takes
            it off true ones.
    """

    controller: AbstractController
    observer: AbstractObserver
    reference: AbstractReference
    actuators: Command[Actuator]
    dt: Scalar
    guard: Guard
    origin: Origin = eqx.field(static=True, default=MAP_ZERO)

    def untold(self) -> GliderState:
        """A measurement of nothing but zeros: the form of its input."""
        return zeros(GliderState, self.dt)

    def init(self) -> AutopilotState:
        """Everything before the first tick."""
        zero = jnp.zeros_like(self.dt)
        still = zeros(GliderState, zero)
        return AutopilotState(
            started=jnp.asarray(False),
            time=TimeState(
                now=zero, stamp=zero, offset=zero, steady=jnp.asarray(0, jnp.int32)
            ),
            silent=jnp.asarray(0, jnp.int32),
            measured=still,
            attitude=still.attitude(),
            held=zeros(Command, zero),
            planned=self._planned(zero),
            reference=self.reference.init(still),
            controller=self.controller.init(),
            observer=self.observer.init(still),
        )

    def plan(self, state: AutopilotState, time: Scalar) -> Any:
        """The reference's plan for a tick at a reading of the clock [s]."""
        return self._planned(self._mission_time(state, time)[0].now)

    def _planned(self, now: Scalar) -> Any:
        return jax.tree.map(lambda x: x[0], self.reference.plan(now[None]))

    def step(
        self,
        state: AutopilotState,
        time: Scalar,
        measured: GliderState,
        planned: Any,
        *,
        altitude: Scalar | None = None,
        current: tuple[Scalar, Scalar] | None = None,
    ) -> tuple[AutopilotState, Command[Scalar], Counter]:
        """One control tick.

        Args:
            state: state from `init` or from the previous tick.
            time: reading of the clock [s], from zero at the start of the mission.
            measured: the measurement; NaN where a number is missing (`GliderState`
                refuses NaN where it is built: put it there with `eqx.tree_at`).
            planned: row of `plan`, or numbers of one's own.
            altitude: height over the bottom [m], or None where nothing tells it.
            current: current that is reckoned with, north and east [m/s], or None.

        Returns:
            The next state, the command for the actuators and the status word.
        """
        following, clock = self._mission_time(state, time)
        planned, replaced = believed_plan(planned, state.planned)
        believed = map_fields(within, measured, state.measured, self.guard.ranges())
        complete = all_of(map_fields(is_within, measured, self.guard.ranges()))
        silent = jnp.where(complete, 0, jnp.minimum(state.silent + 1, MANY))
        lost = ~(state.started | complete) | self._too_long(silent)
        afresh = complete & (~state.started | self._too_long(state.silent))
        observer, observer_reset = self._observe(state, believed, complete, afresh)
        attitude = believed.attitude()
        known = Measurement(
            state=believed,
            attitude=attitude,
            applied=state.held,
            disturbance=self.observer.estimate(observer),
            altitude=altitude,
            current=current,
        )
        aim, guidance = self._guide(state, planned, known)
        wanted, controller, controller_reset = self._decide(
            state, known, aim, (complete, afresh | lost)
        )
        usable = sound(wanted)
        hold = ~usable | aim.finished
        target = select(lost, self.guard.safe, select(hold, state.held, wanted))
        command, held = self._command(state.held, target, believed.depth)
        flags = {
            "measurement_held": ~complete,
            "measurement_lost": lost,
            **clock,
            "reference_held": replaced,
            "command_held": ~usable & ~lost,
            "state_reset": afresh | observer_reset | controller_reset,
            "saturated": ~all_of(map_fields(is_within, target, self.limits())),
            "finished": aim.finished,
            "sample_refused": jnp.asarray(False),
        }
        after = AutopilotState(
            started=state.started | complete,
            time=following,
            silent=silent,
            measured=believed,
            attitude=attitude,
            held=held,
            planned=planned,
            reference=guidance,
            controller=controller,
            observer=observer,
        )
        word = sum(jnp.where(flags[name], bit, 0) for name, bit in BITS.items())
        return after, command, jnp.asarray(word, jnp.int32)

    def _mission_time(
        self, state: AutopilotState, time: Scalar
    ) -> tuple[TimeState, dict[str, Flag]]:
        return mission_time(self.guard, self.dt, state.time, state.started, time)

    def _too_long(self, silent: Counter) -> Flag:
        return silent * self.dt > self.guard.patience

    def _observe(
        self, state: AutopilotState, believed: GliderState, complete: Flag, afresh: Flag
    ) -> tuple[Any, Flag]:
        """The observer's state now that the measurement is known."""
        before = Measurement(
            state=state.measured,
            attitude=state.attitude,
            applied=state.held,
            disturbance=self.observer.estimate(state.observer),
        )
        stepped = self.observer.step(
            state.observer, before, state.held, believed, self.dt
        )
        broken = complete & ~sound(stepped)
        following = select(complete, stepped, state.observer)
        return select(afresh | broken, self.observer.init(believed), following), broken

    def _guide(
        self, state: AutopilotState, planned: Any, known: Measurement
    ) -> tuple[Reference, Any]:
        """The reference of this tick, and its next state."""
        begun = select(state.started, state.reference, self.reference.init(known.state))
        aim, following = self.reference.step(begun, planned, known, self.dt)
        return aim, select(sound(following), following, begun)

    def _decide(
        self,
        state: AutopilotState,
        known: Measurement,
        aim: Reference,
        when: tuple[Flag, Flag],
    ) -> tuple[Command[Scalar], Any, Flag]:
        """The wanted command, the controller's next state, and whether it broke."""
        complete, afresh = when
        begun = select(afresh, self.controller.init(), state.controller)
        bounds = self.controller.bounds(aim.clock)
        wanted, following, _ = self.controller.step(
            begun, informed(known, aim), aim, bounds, self.dt
        )
        wanted = obeyed(wanted, aim, known.applied)
        broken = ~sound(following)
        going = complete & ~aim.finished
        following = select(broken, self.controller.init(), following)
        return wanted, select(going, following, begun), broken & going

    def _command(
        self, held: Command[Scalar], target: Command[Scalar], depth: Scalar
    ) -> tuple[Command[Scalar], Command[Scalar]]:
        """The command sent to the actuators, and their next positions.

        Rates are limited here too, but for a servo with a lag, which has its own.
        """
        intact = map_fields(
            lambda a: dataclasses.replace(a, failure=None), self.actuators
        )
        moved = follow_all(intact, held, target, self.dt, depth=depth)
        sent = map_fields(saturate, target, self.limits())
        command = map_fields(
            lambda s, m, a: m if a.time_constant is None else s, sent, moved, intact
        )
        return command, moved

    def limits(self) -> Command[Scalar]:
        """Limits of the actuators [kg, m, rad]."""
        return map_fields(lambda a: a.limit, self.actuators)
