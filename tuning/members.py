"""The ensemble that gains are tuned on: seas and vehicles, drawn by key.

Member i of a set depends on the set's key and i alone. Training, validation and test
sets have keys of their own, so no member is in two of them.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider._types import Scalar, Series
from jaxglider.disturbances import AbstractDisturbance, Sinusoid, Sum
from jaxglider.rollout import ClosedLoop
from jaxglider.signals import BodyAxes, GliderState
from jaxglider.vehicle.parameters import GliderParameters
from jaxglider.vehicle.uncertainty import UniformUncertainty

TRAINING, VALIDATION, TEST = range(3)


class Member(eqx.Module):
    """One glider in one sea; an ensemble is this with a leading axis.

    Attributes:
        parameters: of the true glider.
        initial_state: where it starts.
        disturbance: the law of its sea.
        key: of that sea's chance.
    """

    parameters: GliderParameters
    initial_state: GliderState
    disturbance: AbstractDisturbance
    key: jax.Array


@dataclasses.dataclass(frozen=True)
class Spread:
    """How far members differ from the nominal case.

    Attributes:
        parameters: half width of each true parameter that the paper's uncertainty
            covers, relative.
        amplitude: half width of each sinusoid's amplitude, relative; its phase is then
            drawn from the whole circle. Zero leaves the sinusoids alone.
        position: half width of the starting position, each direction [m].

    Raises:
        ValueError: a number outside [0, 1), or a negative distance.
    """

    parameters: float = 0.2
    amplitude: float = 0.5
    position: float = 0.0

    def __post_init__(self) -> None:
        for name in ("parameters", "amplitude"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise ValueError(f"{name} must be in [0, 1); received {value}.")
        if not 0.0 <= self.position < float("inf"):
            raise ValueError(
                f"position must be zero or positive; received {self.position}."
            )


def nominal_member(loop: ClosedLoop) -> Member:
    """The loop's own glider and sea, as an ensemble of one."""
    scenario = loop.scenario
    member = Member(
        scenario.plant.parameters,
        scenario.initial_state,
        scenario.disturbance,
        jr.key_data(jr.key(0)),
    )
    return jax.tree.map(lambda x: jnp.asarray(x)[None], member)


def sample_members(
    loop: ClosedLoop, seed: int, kind: int, count: int, spread: Spread
) -> Member:
    """An ensemble.

    Args:
        loop: its scenario is the nominal case.
        seed: of all sets.
        kind: `TRAINING`, `VALIDATION` or `TEST`.
        count: number of members.
        spread: how far they differ.
    """
    if count < 1:
        raise ValueError(f"members must be at least 1; received {count}.")
    root = jr.fold_in(jr.key(seed), kind)
    scenario = loop.scenario
    uncertainty = UniformUncertainty(spread.parameters)

    def draw(number: jax.Array) -> Member:
        vehicle, sea, start, chance = jr.split(jr.fold_in(root, number), 4)
        return Member(
            uncertainty.sample(vehicle, scenario.plant.parameters),
            _moved(scenario.initial_state, start, spread.position),
            _varied(scenario.disturbance, sea, spread.amplitude),
            jr.key_data(chance),
        )

    return jax.vmap(draw)(jnp.arange(count))


def with_member(
    loop: ClosedLoop, member: Member
) -> tuple[ClosedLoop, BodyAxes[Series]]:
    """The closed loop of one member, and its sea."""
    changed = eqx.tree_at(
        lambda at: (at.scenario.plant.parameters, at.scenario.initial_state),
        loop,
        (member.parameters, member.initial_state),
    )
    times = loop.scenario.clock.times()
    return changed, member.disturbance.realise(jr.wrap_key_data(member.key), times)


def _moved(state: GliderState, key: jax.Array, reach: float) -> GliderState:
    shift = reach * jr.uniform(key, (2,), state.north.dtype, -1.0, 1.0)
    return dataclasses.replace(
        state, north=state.north + shift[0], east=state.east + shift[1]
    )


def _varied(
    disturbance: AbstractDisturbance, key: jax.Array, half_width: float
) -> AbstractDisturbance:
    """Every sinusoid with its own amplitudes and phases; chance comes from the key."""
    if isinstance(disturbance, Sum):
        terms = enumerate(disturbance.terms)
        return Sum(tuple(_varied(t, jr.fold_in(key, i), half_width) for i, t in terms))
    if not isinstance(disturbance, Sinusoid) or half_width == 0.0:
        return disturbance

    def draw(values: BodyAxes[Scalar], own: jax.Array, low: float, high: float) -> Any:
        leaves = values.fields()
        drawn = jr.uniform(own, (6,), leaves[0].dtype, low, high)
        return leaves, drawn

    amplitude, factor = draw(
        disturbance.amplitude, jr.fold_in(key, 0), 1.0 - half_width, 1.0 + half_width
    )
    phase, shift = draw(disturbance.phase, jr.fold_in(key, 1), -jnp.pi, jnp.pi)
    return Sinusoid(
        BodyAxes(*(a * f for a, f in zip(amplitude, factor, strict=True))),
        disturbance.frequency,
        BodyAxes(*(p + s for p, s in zip(phase, shift, strict=True))),
    )
