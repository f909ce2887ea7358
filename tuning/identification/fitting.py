"""One fit: a vehicle, a flight, a kind, and which of its dives are held out."""

import dataclasses
import time
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from jaxglider.vehicle.parameters import VehicleData
from tuning.identification.glider import IdentifiedGlider, with_values
from tuning.identification.information.least_squares import Solution, joined, solve
from tuning.identification.information.likelihood import SearchedStage, profiles
from tuning.identification.information.manoeuvres import Advice, advice
from tuning.identification.parameters import FreeParameter, free_parameters, placed
from tuning.identification.record.uniform import Flight
from tuning.identification.samples import Linearised, chosen_rows, compared
from tuning.identification.stages import (
    TURNING,
    Plan,
    Stage,
    fitted_channels,
    held_out_dives,
    make_stages,
)
from tuning.identification.start import balanced_offset, starting_glider
from tuning.identification.windows import cut


@dataclasses.dataclass(frozen=True)
class Fit:
    """A fitted glider.

    Attributes:
        plan: task of the fit.
        vehicle: vehicle file that it started from.
        flight: the record on one clock.
        before: glider as it started.
        after: glider as fitted.
        solution: coordinates, covariance and noise.
        profiles: ends of the profile's 95 % interval of the numbers told worst, by
            name; NaN for an end that was not found.
        advice: gain of further manoeuvres, for each number.
        seconds: time that it took [s], compiling included.
    """

    plan: Plan
    vehicle: VehicleData
    flight: Flight
    before: IdentifiedGlider
    after: IdentifiedGlider
    solution: Solution
    profiles: Mapping[str, tuple[float, float]]
    advice: tuple[Advice, ...]
    seconds: float


def fit_flight(
    flight: Flight,
    vehicle: VehicleData,
    volume: float | None = None,
    kind: str = "driven",
    free: Sequence[str] = (),
    speed: bool = True,
    split: str = "half",
    worst: int = 2,
) -> Fit:
    """Fit a vehicle to a flight.

    Args:
        flight: the record on one clock.
        vehicle: vehicle to start from; its doubts are the priors.
        volume: V [m³]; by default the vehicle's mass over the record's mean density.
        kind: `steady`, `driven` or `closed`.
        free: names of free numbers; by default those that the record may tell.
        speed: whether a recorded speed is used.
        split: `half` or `alternate`, the dives held out.
        worst: number of numbers, those told worst, whose likelihood is profiled.

    Raises:
        ValueError: the record lacks what is needed, or an argument cannot be used.
        FloatingPointError: the model is not finite where the fit begins.
    """
    begun = time.monotonic()
    stages = make_stages(flight, vehicle, kind, free, speed)
    before = glider = starting_glider(vehicle, flight, volume)
    held_out = held_out_dives(flight.dives(), split)
    done: list[SearchedStage] = []
    chosen: list[FreeParameter] = []
    for stage in stages:
        if stage.kind == "closed" and not free:
            offset = balanced_offset(glider, flight)
            glider = with_values(glider, {"position_offset": offset})
            before = with_values(before, {"position_offset": offset})
        numbers = free_parameters(stage.names, glider, vehicle)
        searched = _search(flight, glider, numbers, stage, held_out)
        if searched is None:
            continue
        glider = placed(glider, numbers, jnp.asarray(searched.solution.x))
        done.append(searched)
        chosen += numbers
    plan = Plan(
        kind,
        stages,
        tuple(chosen),
        fitted_channels(flight, kind, speed),
        split,
        held_out,
    )
    whole = joined([one.solution for one in done])
    ends, more = profiles(done, worst), advice(done)
    seconds = time.monotonic() - begun
    return Fit(plan, vehicle, flight, before, glider, whole, ends, more, seconds)


def _search(
    flight: Flight,
    glider: IdentifiedGlider,
    numbers: tuple[FreeParameter, ...],
    stage: Stage,
    held_out: tuple[int, ...],
) -> SearchedStage | None:
    """One stage; None where there are too few samples of its groups.

    Raises:
        ValueError: steady glides themselves are too few.
    """
    wanted = compared(flight, stage.kind) & ~np.isin(flight.dive, held_out)
    stretches = cut(flight, stage.kind, wanted)
    measured, rows, unbroken = chosen_rows(flight, stretches, stage.groups)
    if not measured:
        if any(group.endswith(TURNING) for group in stage.groups):
            return None
        raise ValueError(
            "the record must have steady glides of some minutes in the dives that are "
            f"fitted; {wanted.sum() * flight.dt:.0f} s can be compared. See `jaxglider "
            "record` for its gaps."
        )
    model = Linearised(glider, numbers, stretches.inputs, stage.kind, rows)
    solution = solve(model, measured, len(numbers), stretches=unbroken)
    return SearchedStage(numbers, model, measured, solution)
