"""The plan of a fit: which numbers are searched by which samples, and what is held out.

Samples of a channel in steady glides are a group of the channel's name; those of turns
are a group of their own, for what the model leaves out is larger there.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxglider.core.containers import choose
from jaxglider.vehicle.parameters import VehicleData
from tuning.identification.parameters import (
    PITCHING,
    TURNED,
    FreeParameter,
    glide_names,
)
from tuning.identification.predict import KINDS
from tuning.identification.record.uniform import Flight

SPLITS = ("half", "alternate")
"""Ways of holding dives out: the second half of them, or every other one."""
_STEADY = ("depth_rate", "speed")
TURNING = ":turning"
"""Ending of a group of samples that are not of a steady glide."""


@dataclasses.dataclass(frozen=True)
class Stage:
    """One search: some numbers, by some samples, all others held where they are.

    Attributes:
        kind: kind of the model.
        names: names of the free numbers, `*` for any letters.
        groups: groups of samples that are compared.
    """

    kind: str
    names: tuple[str, ...]
    groups: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Plan:
    """The task of a fit: free numbers, channels, and dives held out.

    Attributes:
        kind: kind of the fit.
        stages: searches, one after the other.
        free: free numbers of all stages.
        channels: channels that are fitted.
        split: way of holding dives out.
        held_out: numbers of the dives that are held out.
    """

    kind: str
    stages: tuple[Stage, ...]
    free: tuple[FreeParameter, ...]
    channels: tuple[str, ...]
    split: str
    held_out: tuple[int, ...]


def held_out_dives(dives: int, split: str) -> tuple[int, ...]:
    """Numbers of the dives that are held out, of those counted from 1.

    Args:
        dives: number of dives.
        split: `half` or `alternate`.

    Raises:
        ValueError: the split has another name.
    """
    choose("split", split, SPLITS)
    if split == "half":
        return tuple(range(dives // 2 + 1, dives + 1))
    return tuple(range(2, dives + 1, 2))


def fitted_channels(flight: Flight, kind: str, speed: bool) -> tuple[str, ...]:
    """Channels of the record that a fit compares.

    Args:
        flight: the record.
        kind: kind of the fit.
        speed: whether a recorded speed is used.
    """
    names = ["depth_rate"]
    if speed and flight.has("speed"):
        names.append("speed")
    if kind == "closed":
        names.append("pitch")
        if flight.has("mass_angle"):
            names += ["roll", "turn_rate"] if flight.has("heading") else ["roll"]
    return tuple(names)


def make_stages(
    flight: Flight,
    vehicle: VehicleData,
    kind: str = "driven",
    free: Sequence[str] = (),
    speed: bool = True,
) -> tuple[Stage, ...]:
    """Decide what is free, and by which samples it is searched.

    By default what steady glides tell is not touched by turns: first drag, mass and,
    where a speed is fitted, lift and the tilt of the pitch sensor, by steady glides;
    then how late the actuators act, by the turns; the closed fit instead everything
    that pitches the glider, by its pitch, and where it rolls, what turns it.

    Args:
        flight: the record.
        vehicle: vehicle file.
        kind: kind of the fit.
        free: names of free numbers, all searched at once.
        speed: whether a recorded speed is used.

    Raises:
        ValueError: the record lacks what the kind needs.
    """
    choose("kind", kind, KINDS)
    if kind == "closed" and not flight.has("mass_position"):
        raise ValueError(
            "kind: the closed fit needs mass_position, the place of the moving mass, "
            "which the record lacks; use driven."
        )
    if kind == "closed" and vehicle.body is None:
        raise ValueError(
            f"kind: the closed fit needs a vehicle with a table [body]; {vehicle.name} "
            "has none. `jaxglider vehicles --show seawing` prints one."
        )
    channels = fitted_channels(flight, kind, speed)
    if free:
        turns = tuple(name + TURNING for name in channels if name not in _STEADY)
        return (Stage(kind, tuple(free), (*channels, *turns)),)
    depth = float(np.percentile(flight.depth[flight.good], 98))
    glides = tuple(name for name in channels if name in _STEADY)
    along = tuple(glide_names("speed" in channels, depth))
    if kind == "steady":
        return (Stage(kind, along, glides),)
    stages = [Stage("driven", along, glides)]
    if kind == "driven":
        return (*stages, Stage(kind, ("actuator_lag",), ("depth_rate" + TURNING,)))
    stages.append(Stage(kind, PITCHING, ("pitch", "pitch" + TURNING)))
    if "roll" in channels:
        lateral = tuple(n for n in ("roll", "turn_rate") if n in channels)
        stages.append(Stage(kind, TURNED, lateral))
    return tuple(stages)
