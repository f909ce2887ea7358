"""The straight glides of a yo: one way down and one way up, each held for good.

A half of a yo has a ballast and a pitch, or an angle of the path; what the glider does
with them follows from its polar. Nothing tracks the depth there, so a loop's stability
on it is another than on a glide whose depth is wanted.
"""

import dataclasses
import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxglider.guidance import AttitudeSchedule, Schedule
from jaxglider.guidance.phases import CLIMB, DIVE, HalfYo
from jaxglider.guidance.progress import YoState
from jaxglider.guidance.yo import Yo
from jaxglider.signals import GliderState
from jaxglider.simulation.checks.task import ATTACKS
from jaxglider.simulation.scenario import Scenario
from jaxglider.trim.steady_motion import SteadyMotion
from jaxglider.trim.straight_glide import glide_polars

_BOTTOMLESS = 1e6
"""Depth that no glide comes to [m]."""


class HeldHalf(Yo):
    """A yo that is always on its way down, or up, towards north.

    Attributes:
        phase: number of the phase.
    """

    phase: int = eqx.field(static=True, default=DIVE)
    can_finish: ClassVar[bool] = False

    @classmethod
    def of(cls, yo: Yo, angle: float, motion: SteadyMotion) -> "HeldHalf":
        """The half of a yo that flies a steady glide.

        Args:
            yo: the yo.
            angle: ξ [rad] of the glide, positive in a climb.
            motion: the glide's state and command.
        """
        climbs = angle > 0.0
        name = "climb" if climbs else "dive"
        half = getattr(yo.settings, name)
        held = dataclasses.replace(
            half,
            angle=angle if half.of_path else motion.state.pitch,
            buoyancy_mass=motion.command.buoyancy_mass,
            depth_rate=None,
        )
        north = AttitudeSchedule(Schedule([0.0], [0.0], [0.0], [0.0]))
        settings = dataclasses.replace(
            yo.settings,
            **{name: held},
            bottom=yo.settings.bottom * 0.0 + _BOTTOMLESS,
            altitude=None,
            yos=None,
            duration=None,
        )
        return cls(north, settings, CLIMB if climbs else DIVE)

    def init(self, state: GliderState) -> YoState:
        """The state of a yo that is in the phase from the first tick on."""
        phase = jnp.asarray(self.phase, jnp.int32)
        return dataclasses.replace(super().init(state), phase=phase)


def half_glides(scenario: Scenario) -> list[tuple[float, float]]:
    """Angle ξ [rad] and depth rate [m/s] of the way down and the way up of a yo.

    A half that the glider has no steady glide for is left out, and so is a spiral, in
    which nobody steers.

    Args:
        scenario: scenario, with concrete numbers.
    """
    yo = scenario.reference
    if not isinstance(yo, Yo) or yo.settings.spiral is not None:
        return []
    found = []
    for half in (yo.settings.dive, yo.settings.climb):
        glide = _glide(scenario, half)
        if glide is not None:
            angle, speed = glide
            found.append((angle, -speed * math.sin(angle)))
    return found


def _glide(scenario: Scenario, half: HalfYo) -> tuple[float, float] | None:
    """Angle of the path [rad] and speed [m/s] of one half, by the glider's polar."""
    limit = float(scenario.actuators.buoyancy_mass.limit)
    ballast = float(np.clip(float(half.buoyancy_mass), -limit, limit))
    angles, speeds = (
        np.asarray(x)
        for x in glide_polars(scenario.plant, ballast, jnp.asarray(ATTACKS))
    )
    pitches = angles if half.of_path else angles + ATTACKS
    wanted = float(half.angle)
    # A glide falls the way its ballast pulls; of two the faster one is flown.
    known = np.isfinite(pitches) & (angles * wanted > 0.0)
    order = np.argsort(ATTACKS[known])
    pitches, angles, speeds = (x[known][order] for x in (pitches, angles, speeds))
    beyond = pitches - wanted
    crossed = np.flatnonzero(beyond[:-1] * beyond[1:] <= 0.0)
    if not crossed.size:
        return None
    share = beyond[crossed] / (beyond[crossed] - beyond[crossed + 1])
    at = [x[crossed] + share * (x[crossed + 1] - x[crossed]) for x in (angles, speeds)]
    fastest = int(np.argmax(at[1]))
    return float(at[0][fastest]), float(at[1][fastest])


def longest_stay(yo: Yo) -> float:
    """The longest time that a yo keeps a glider at the surface [s].

    Args:
        yo: yo with concrete numbers.
    """
    stay = yo.settings.surface
    again = stay.every_yos is not None or stay.every is not None or stay.at_waypoints
    return max(float(stay.first), float(stay.duration) if again else 0.0)
