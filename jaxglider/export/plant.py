"""The simulated glider, in JAX and as C, to close the loop around exported code."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.environment.water import Water, relative_to_water
from jaxglider.export.autopilot import (
    CONSTANTS,
    Source,
    check_precision,
    header_text,
    source_text,
)
from jaxglider.export.c.outlined import Functions
from jaxglider.export.c.source import Argument, Structure, Written, write_function
from jaxglider.signals import BodyAxes, Command, GliderState, zeros
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.motion import move
from jaxglider.simulation.tick import TickInput, TickPlan
from jaxglider.vehicle.actuators import Actuator
from jaxglider.vehicle.plant import AbstractPlant


class ExportedPlant(eqx.Module):
    """The true glider, and the water that it is in.

    Attributes:
        dt: control tick [s].
    """

    plant: AbstractPlant
    actuators: Command[Actuator]
    dt: Scalar
    water: Water | None


class PlantState(eqx.Module):
    """The simulated glider between two ticks.

    Attributes:
        held: positions of the actuators [kg, m, rad].
        time: time since the start [s].
    """

    state: GliderState
    held: Command[Scalar]
    time: Scalar


def plant_source(loop: ClosedLoop, about: str) -> Source:
    """The simulated glider as plant.h and plant.c: for tests only.

    Args:
        loop: the closed loop, in double precision.
        about: a line for the head of the files.
    """
    check_precision(loop.scenario.plant)
    scenario = loop.scenario
    example = PlantState(
        scenario.initial_state,
        zeros(Command, scenario.clock.dt),
        jnp.zeros_like(scenario.clock.dt),
    )
    force = zeros(BodyAxes, scenario.clock.dt)
    structures = {
        "parameters": Structure(
            "plant_parameters",
            "The true glider.",
            truth_of(loop),
        ),
        "state": Structure(
            "plant_state", "The glider between two ticks.", example, hidden=("state",)
        ),
        "command": Structure("plant_command", "Asked for.", example.held),
        "force": Structure(
            "plant_force", "External force [N] and moment [N m], body frame.", force
        ),
    }

    shared = Functions()
    functions = _plant_functions(loop, structures, shared)
    return Source(
        header=header_text("plant", about, structures, functions),
        source=source_text(
            "plant", about, structures["parameters"].example, functions, shared
        ),
        functions=functions,
        shared=shared,
        structures=structures,
    )


def _plant_functions(
    loop: ClosedLoop, structures: dict[str, Structure], shared: Functions
) -> dict[str, Written]:
    state = structures["state"]

    def init(p: Any) -> PlantState:
        return state.example

    def step(
        p: ExportedPlant, now: PlantState, wanted: Command[Scalar], f: Any
    ) -> PlantState:
        return drift(loop, p, now, wanted, f)

    def seen(p: ExportedPlant, now: PlantState) -> PlantState:
        return dataclasses.replace(now, state=through_the_water(p, now))

    parameters = (CONSTANTS["plant"], structures["parameters"].example)
    return {
        "plant_init": write_function(
            "plant_init",
            "The glider at the start.",
            init,
            parameters,
            [Argument("state", state, reads=False, writes=True)],
            shared,
        ),
        "plant_step": write_function(
            "plant_step",
            "One tick under a command and a constant force.",
            step,
            parameters,
            [
                Argument("state", state, writes=True),
                Argument("command", structures["command"]),
                Argument("force", structures["force"]),
            ],
            shared,
        ),
        "plant_seen": write_function(
            "plant_seen",
            "The glider as an autopilot knows it: velocities are through the water.",
            seen,
            parameters,
            [
                Argument("state", state),
                Argument("seen", state, reads=False, writes=True),
            ],
            shared,
        ),
    }


def truth_of(loop: ClosedLoop) -> ExportedPlant:
    """The true glider of a closed loop."""
    scenario = loop.scenario
    return ExportedPlant(
        plant=scenario.plant,
        actuators=scenario.actuators,
        dt=scenario.clock.dt,
        water=scenario.water,
    )


def through_the_water(truth: ExportedPlant, now: PlantState) -> GliderState:
    """The state that an autopilot is told, with the velocity through the water.

    Args:
        truth: numbers of the glider, from `truth_of`.
        now: state of the glider, over ground.
    """
    return relative_to_water(truth.water, now.state, now.time)[0]


def drift(
    loop: ClosedLoop,
    truth: ExportedPlant,
    now: PlantState,
    wanted: Command[Scalar],
    force: BodyAxes[Scalar],
) -> PlantState:
    """The glider one tick later, under a constant force.

    Args:
        loop: closed loop with the glider.
        truth: numbers of the glider, from `truth_of`.
        now: state of the glider and of its actuators.
        wanted: command given to the actuators.
        force: constant force on it [N, N m], body frame.
    """
    clock = dataclasses.replace(loop.scenario.clock, dt=truth.dt)
    scenario = dataclasses.replace(
        loop.scenario,
        plant=truth.plant,
        actuators=truth.actuators,
        clock=clock,
        water=truth.water,
    )
    plan = TickPlan(
        time=now.time,
        force_end=force,
        planned=None,
        bounds=None,
        judging=None,
        noise_end=None,
    )
    inputs = TickInput(plan, force_start=force, noise_start=None)
    applied, following = move(scenario, now.state, now.held, wanted, inputs)
    return PlantState(following, applied, now.time + truth.dt)
