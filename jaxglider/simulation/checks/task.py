"""Demands on a glider against what it can do: angles, depths, rates, times."""

import dataclasses
import math
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from jaxglider.guidance import (
    AbstractReference,
    AttitudeSchedule,
    Schedule,
    WaypointPath,
)
from jaxglider.guidance.yo import Yo
from jaxglider.signals import CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario
from jaxglider.trim.straight_glide import glide_polars

DEEPEST, STEEPEST = 6000.0, math.radians(80.0)
"""Depth that no glider goes beyond [m], and an angle beyond which none glides [rad]."""
ATTACKS = np.concatenate(
    [
        side * np.geomspace(math.radians(0.05), math.radians(25.0), 200)
        for side in (-1, 1)
    ]
)
"""Angles of attack that glides are looked for at [rad]."""


@dataclasses.dataclass(frozen=True)
class Ability:
    """Steady glides of a glider with all its ballast, a dive as a climb.

    Attributes:
        angles: ξ of the glides [rad].
        speeds: speeds on them [m/s].
    """

    angles: np.ndarray
    speeds: np.ndarray

    @classmethod
    def of(cls, scenario: Scenario) -> "Ability":
        """The glides of a plant with its actuators.

        Args:
            scenario: plant and actuators, with concrete numbers.
        """
        limit = scenario.actuators.buoyancy_mass.limit
        attacks = jnp.asarray(ATTACKS)
        both = [glide_polars(scenario.plant, s * limit, attacks) for s in (1, -1)]
        angles, speeds = (
            np.concatenate([np.asarray(b[i]) for b in both]) for i in (0, 1)
        )
        known = np.isfinite(angles) & np.isfinite(speeds)
        return cls(angles[known], speeds[known])

    def shallowest(self, dive: bool) -> float:
        """Modulus of the flattest dive or climb [rad]; 0 if none is known."""
        some = self.angles[(self.angles < 0.0) == dive]
        return float(np.abs(some).min()) if some.size else 0.0

    def fastest(self, angle: float) -> float:
        """Largest depth rate, in modulus, near an angle [m/s]; infinite if unknown."""
        near = np.abs(self.angles - angle) < math.radians(3.0)
        if not near.any():
            return math.inf
        return float(np.abs(self.speeds[near] * np.sin(self.angles[near])).max())


def task_warnings(loop: ClosedLoop, *, whole: bool = True) -> list[str]:
    """Warnings on a task that the glider cannot do, or that is hardly meant.

    Args:
        loop: closed loop with concrete numbers.
        whole: flag, the run is meant to last as long as the task.
    """
    scenario = loop.scenario
    found = [*_depths(scenario), *(_times(scenario) if whole else [])]
    asked = list(_asked(scenario.reference))
    if asked:
        ability = Ability.of(scenario)
        for where, angle, rate in asked:
            found.extend(_glide(ability, where, angle, rate))
    return list(dict.fromkeys(found))


def _asked(reference: AbstractReference) -> Iterator[tuple[str, float, float | None]]:
    """Key, angle of the path and depth rate of each glide asked for."""
    schedule = schedule_of(reference)
    if schedule is not None:
        rows = zip(schedule.gliding_angle, schedule.depth_rate, strict=True)
        for number, (angle, rate) in enumerate(rows):
            yield (
                f"segment {number + 1} of reference.schedule",
                float(angle),
                float(rate),
            )
    if isinstance(reference, Yo):
        settings = reference.settings
        for name, half, sign in (
            ("dive", settings.dive, 1),
            ("climb", settings.climb, -1),
        ):
            rate = None if half.depth_rate is None else sign * float(half.depth_rate)
            if half.of_path:
                yield f"reference.yo.{name}", float(half.angle), rate


def schedule_of(reference: AbstractReference) -> Schedule | None:
    """The schedule that gives depth and gliding angle, if one does.

    Args:
        reference: task of a scenario.
    """
    if isinstance(reference, AttitudeSchedule):
        return reference.schedule
    return reference.vertical if isinstance(reference, WaypointPath) else None


def _glide(
    ability: Ability, where: str, angle: float, rate: float | None
) -> Iterator[str]:
    """Warnings on one glide: its sign, and whether it is too flat, steep or fast."""
    degrees = math.degrees(angle)
    dive = angle < 0.0
    if rate is not None and rate * angle > 0.0:
        word = "sinks" if rate > 0.0 else "rises"
        yield (
            f"{where} glides at {degrees:.3g} deg and {word} at {abs(rate):.3g} m/s: a "
            "gliding angle is negative in a dive, a depth rate positive. One of them "
            "has the wrong sign."
        )
        return
    flattest = ability.shallowest(dive)
    if 0.0 < abs(angle) < flattest or (angle == 0.0 and rate):
        yield (
            f"{where} glides at {degrees:.3g} deg, flatter than this glider can: its "
            f"shallowest {'dive' if dive else 'climb'} is "
            f"{math.degrees(flattest):.3g} deg (`jaxglider trim` shows its glides)."
        )
    elif abs(angle) > STEEPEST:
        yield (
            f"{where} glides at {degrees:.3g} deg, steeper than any glider; angles in "
            "keys ending _deg are degrees."
        )
    fastest = ability.fastest(angle)
    if rate is not None and abs(rate) > fastest:
        yield (
            f"{where} asks for a depth rate of {rate:.3g} m/s at {degrees:.3g} deg; "
            f"with all its ballast this glider reaches {fastest:.2g} m/s there."
        )


def _depths(scenario: Scenario) -> Iterator[str]:
    """Warnings on depths beyond the bottom, or any glider."""
    deepest, when = _deepest(scenario)
    if deepest > DEEPEST:
        yield (
            f"the wanted depth comes to {deepest:.4g} m at {when:.4g} s; no glider "
            "goes beyond 6000 m, most not beyond 1000 m."
        )
    seabed = scenario.seabed
    if seabed is None:
        return
    state = scenario.initial_state
    altitude = float(seabed.altitude(state))
    bottom = altitude + float(state.depth)
    if altitude < 0.0:
        yield "the glider starts below the bottom: see seabed and initial_state."
    elif deepest > bottom and not isinstance(scenario.reference, Yo):
        yield (
            f"the wanted depth comes to {deepest:.4g} m at {when:.4g} s, below the "
            f"bottom at {bottom:.4g} m."
        )


def _deepest(scenario: Scenario) -> tuple[float, float]:
    """The greatest wanted depth of a run [m], and when it is wanted [s]."""
    if isinstance(scenario.reference, Yo):
        return float(scenario.reference.settings.bottom), 0.0
    schedule = schedule_of(scenario.reference)
    if schedule is None:
        return 0.0, 0.0
    times, depths = wanted_depths(schedule, scenario)
    return float(depths.max()), float(times[depths.argmax()])


def wanted_depths(
    schedule: Schedule, scenario: Scenario
) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and wanted depths [m] at the ends of the segments that are flown.

    Args:
        schedule: schedule that gives the depth.
        scenario: scenario whose clock says how long it is flown.
    """
    # Wanted depth is linear within a segment: the ends tell.
    end = scenario.clock.ticks * float(scenario.clock.dt)
    begun = np.asarray(schedule.start, np.float64)
    times = np.append(begun[begun < end], end)
    lengths, rates = np.diff(times), np.asarray(schedule.depth_rate, np.float64)
    sunk = np.cumsum(lengths * rates[: len(lengths)])
    return times, float(schedule.initial_depth) + np.append(0.0, sunk)


def _times(scenario: Scenario) -> Iterator[str]:
    """Warnings on segments that are never flown, or too short to settle in."""
    schedule = schedule_of(scenario.reference)
    if not isinstance(scenario.reference, AttitudeSchedule) or schedule is None:
        return
    end = scenario.clock.ticks * float(scenario.clock.dt)
    starts = np.asarray(schedule.start, np.float64)
    after = starts[starts >= end]
    if after.size:
        yield (
            f"the run ends at {end:.4g} s: {after.size} of {starts.size} segments, "
            f"from {after[0]:.4g} s on, are never flown. See clock.duration_s."
        )
    flown = np.append(starts[starts < end], end)
    shortest = float(np.diff(flown).min())
    specification = scenario.specification
    if specification is None:
        return
    times = specification.required_settling()
    known = {c: getattr(times, c) for c in CHANNELS if getattr(times, c) is not None}
    late = [f"{c} {float(t):.4g} s" for c, t in known.items() if float(t) > shortest]
    if late:
        yield (
            f"a segment lasts {shortest:.4g} s, less than errors are given to settle "
            f"({', '.join(late)}): they never have to. See reference.schedule.start_s, "
            "clock.duration_s and [specification]."
        )
