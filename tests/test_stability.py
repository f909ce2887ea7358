"""Natural motions of the closed loop: those of the glider where nothing steers it."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import NoObserver, paper
from jaxglider.control import AbstractController, ControlRecord
from jaxglider.control.controller import tracking_error
from jaxglider.files.flight.missions import mission_path as shipped
from jaxglider.files.gains import load_gains
from jaxglider.files.mission import load_mission
from jaxglider.navigation.catalogue import make_estimator, usual_instruments
from jaxglider.paper.tuned import tuned_gains
from jaxglider.signals import Command
from jaxglider.simulation.checks.stability import (
    Glide,
    LoopModes,
    glides_of,
    loop_modes,
    lost,
    statement,
)
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.trim.linear_model import linearise
from jaxglider.trim.modes import transmission_zeros
from jaxglider.trim.steady_motion import Target, steady_motion
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import PAPER

DIVE = Glide(-math.pi / 4, 0.1)


class Held(AbstractController):
    """A law that always asks for one command.

    Attributes:
        command: command of every tick.
    """

    command: Command
    model = None
    funnel = None

    def init(self):
        """No state."""
        return None

    def step(self, state, measurement, reference, bounds, dt):
        """The command."""
        error, _ = tracking_error(measurement, reference)
        return self.command, state, ControlRecord(error, error)


def test_without_a_law_they_are_the_modes_of_the_trimmed_glider():
    scenario = paper.make_scenario("switching", "rigid-body", actuators="ideal")
    wanted = Target(speed=DIVE.speed, glide_angle=DIVE.angle, turn_rate=0.0)
    motion = jax.jit(steady_motion)(scenario.plant, wanted)
    a, _ = linearise(scenario.plant, motion)
    expected = [s for s in np.linalg.eigvals(np.asarray(a)) if abs(s) > 1e-6]
    held = Held(Command(*(x + 0.0 for x in vars(motion.command).values())))
    loop = ClosedLoop(scenario, held, NoObserver())
    (modes,) = loop_modes(loop, (DIVE,))
    rates = [s for s in expected if s.imag >= 0.0]
    rates.sort(key=lambda s: -s.real)
    np.testing.assert_allclose(modes.rates, rates, rtol=1e-4)
    assert modes.growth == pytest.approx(rates[0].real, rel=1e-4)


def test_a_law_that_flies_on_sensors_is_told_its_state():
    scenario = paper.make_scenario("switching", "rigid-body", actuators="ideal")
    bare = ClosedLoop(scenario, Held(Command(0.1, 0.01, 0.0)), NoObserver())
    sensors, model = usual_instruments(), paper.design_model(scenario.plant)
    fitted = dataclasses.replace(
        bare,
        scenario=dataclasses.replace(scenario, instruments=sensors),
        estimator=make_estimator("linear", model, sensors),
    )
    assert fitted.navigator is not None
    assert loop_modes(fitted, (DIVE,)) == loop_modes(bare, (DIVE,))


def test_inversion_loses_the_climb_that_steering_by_bank_holds():
    glide = Glide(math.radians(26.0), -0.1)
    scenario = paper.make_scenario("switching", "rigid-body")
    model = paper.design_model(scenario.plant)
    by_bank = paper.make_law("smc", "switching", model).on(scenario)
    (held,) = loop_modes(by_bank, (glide,))
    assert held.stable
    (lost,) = loop_modes(
        paper.make_law("smc", "switching", model, paper.INVERSION).on(scenario),
        (glide,),
    )
    # An inverse turns the zero of the climbing glider into a pole; gains that are
    # finite leave it a few percent short.
    wanted = Target(speed=glide.speed, glide_angle=glide.angle, turn_rate=0.0)
    motion = jax.jit(steady_motion)(scenario.plant, wanted)
    zeros = transmission_zeros(*map(np.asarray, linearise(scenario.plant, motion)))
    assert lost.growth == pytest.approx(max(zeros.real), rel=0.05)
    assert lost.growth < max(zeros.real)


@pytest.mark.parametrize("plant", ["rigid-body", "seawing"])
@pytest.mark.parametrize("case", paper.SCENARIOS)
def test_fxtppc_with_the_gains_that_come_along_is_stable(case, plant):
    scenario = paper.make_scenario(case, plant)
    model = paper.design_model(scenario.plant)
    loop = load_gains(tuned_gains(case, plant, "fxtppc"), case, model).on(scenario)
    modes = loop_modes(loop, glides_of(loop))
    assert len(modes) == 6
    assert [one.text() for one in modes if not one.stable] == []


def test_glides_are_those_of_the_schedule_in_both_directions():
    loop = paper.make_loop("waypoints", "printed", "smc")
    angles = [round(math.degrees(glide.angle)) for glide in glides_of(loop)]
    assert angles == [-60, -45, -26, 26, 45, 60]
    assert all(glide.angle * glide.depth_rate < 0.0 for glide in glides_of(loop))
    # A task at the usual angle, read from degrees in a file, has it once.
    usual = dataclasses.replace(
        paper.attitude_schedule(), gliding_angle=jnp.full(4, math.radians(-26.0))
    )
    reference = dataclasses.replace(paper.reference("switching"), schedule=usual)
    scenario = dataclasses.replace(loop.scenario, reference=reference)
    found = glides_of(dataclasses.replace(loop, scenario=scenario))
    assert len({glide.angle for glide in found}) == 2
    assert DIVE.mirrored() == Glide(math.pi / 4, -0.1)
    flat = dataclasses.replace(
        paper.attitude_schedule(), gliding_angle=jnp.zeros(4), depth_rate=jnp.zeros(4)
    )
    reference = dataclasses.replace(paper.reference("switching"), schedule=flat)
    scenario = dataclasses.replace(loop.scenario, reference=reference)
    assert glides_of(dataclasses.replace(loop, scenario=scenario)) == ()


def test_a_motion_is_told_by_its_time_and_its_period():
    decaying = LoopModes(DIVE, (complex(-0.01, 0.1), complex(-1.0, 0.0)))
    assert decaying.stable
    assert decaying.text() == (
        "dive at 45 deg, 0.141 m/s: the slowest motion decays e-fold in 100 s while it "
        "swings with 62.8 s"
    )
    growing = LoopModes(DIVE, (complex(0.02, 0.0),))
    assert not growing.stable
    assert "GROWS e-fold in 50 s" in growing.text()
    assert "no verdict" in LoopModes(DIVE, (complex(math.nan),)).text()
    assert statement([decaying]).startswith("the loop is stable on 1 straight glides")
    assert statement([decaying, growing]).startswith("the loop is NOT stable: dive at")
    # Slower than any glide lasts.
    assert LoopModes(DIVE, (complex(5e-4, 0.0),)).stable


def on_shallow_slocum(kind):
    mission = load_mission(shipped("slocum-shallow"))
    case = FlightCase.of_mission(mission)
    (gains,) = case.resolve([PAPER], [kind])
    return case.loop(gains)[1]


def test_a_law_that_stands_on_its_nose_at_the_surface_is_named_beforehand():
    # Designed to run every second and flown every 4 s, the regulator rolls past 90 deg
    # after 92 s of its first stay; on the way down, where it has speed, it is stable.
    paced = on_shallow_slocum("lqr")
    law = dataclasses.replace(paced.controller, period=jnp.asarray(1.0))
    regulator = dataclasses.replace(paced, controller=law)
    down, up = glides_of(regulator)
    assert down.angle < 0.0 < up.angle
    assert all(one.stable for one in loop_modes(regulator, (down, up)))
    (surface,) = lost(regulator)
    assert surface.startswith("the loop is NOT stable at the surface")
    assert "every 4 s" in surface
    # Designed for 4 s it flies the mission to its end, as Slocum's own law does.
    assert lost(paced) == []
    assert lost(load_mission(shipped("slocum-shallow")).loop) == []


def test_glides_of_a_yo_are_those_that_its_ballast_and_pitch_make():
    mission = load_mission(shipped("slocum-shallow"))
    down, up = glides_of(mission.loop)
    # Up and down with the same ballast and pitch.
    assert (up.angle, up.depth_rate) == pytest.approx((-down.angle, -down.depth_rate))
    wanted = Target(speed=down.speed, glide_angle=down.angle, turn_rate=0.0)
    motion = jax.jit(steady_motion)(mission.loop.scenario.plant, wanted)
    half = mission.loop.scenario.reference.settings.dive
    assert bool(motion.converged)
    assert float(motion.command.buoyancy_mass) == pytest.approx(
        float(half.buoyancy_mass), rel=0.02
    )
    assert float(motion.state.pitch) == pytest.approx(float(half.angle), abs=2e-3)


def test_nobody_steers_in_a_spiral_so_nothing_is_said_of_it():
    spiral = load_mission(shipped("seawing-spiral")).loop
    assert glides_of(spiral) == ()
    assert lost(spiral) == []


def test_a_cycle_in_which_all_dies_is_stable():
    quick = LoopModes(DIVE, ())
    assert quick.stable
    assert quick.text().endswith("every motion dies within the law's cycle")
