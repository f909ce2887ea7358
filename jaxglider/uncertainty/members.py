"""Uncertain quantities of a scenario, their distributions, and members drawn.

An uncertain quantity is one number of a scenario, named by its path, with a
distribution for its factor on the nominal value, its offset from it, or itself. A
member is a value for each quantity and a key for what is left to chance within a run:
coloured noise and sensor noise. Its values come from a point of the unit cube (see
`designs`), so that every distribution works with every design.

The controller's design model is not touched: it stays what the designer believes.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from jaxglider.core.containers import Series
from jaxglider.environment.disturbances import GaussMarkov
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario, SensorErrors
from jaxglider.uncertainty.distributions import AbstractDistribution, correlated
from jaxglider.uncertainty.sampling import AbstractSampler


class Member(eqx.Module):
    """One glider in one sea; an ensemble is this with a leading axis.

    Attributes:
        values: values of the uncertain quantities, by their paths in the scenario.
        key: data of the key for what is left to chance within the run.
    """

    values: dict[str, jax.Array]
    key: jax.Array


@dataclasses.dataclass(frozen=True)
class Quantity:
    """One uncertain number: value = offset + scale · x, x from the distribution.

    Attributes:
        name: name in tables and files.
        path: path in the scenario, as `plant.parameters.drag`.
        unit: unit of the value.
        distribution: distribution of x.
        scale: the nominal value where x is a factor on it, else 1.
        offset: the nominal value where x is added to it, else 0.
        origin: number that the scenario's own counts from; see `simulation.origin`.
    """

    name: str
    path: str
    unit: str
    distribution: AbstractDistribution
    scale: float = 1.0
    offset: float = 0.0
    origin: float = 0.0

    def values(self, u: np.ndarray) -> np.ndarray:
        """The values at coordinates u."""
        return self.offset + self.scale * self.distribution.quantile(u)

    def standard_deviation(self) -> float:
        """Standard deviation of the value."""
        return abs(self.scale) * self.distribution.standard_deviation()


@dataclasses.dataclass(frozen=True)
class Group:
    """Quantities that are correlated through a Gaussian copula.

    Attributes:
        name: name of the group.
        members: names of its quantities.
        correlation: correlation matrix of their normal scores.
    """

    name: str
    members: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """All that is uncertain of a scenario.

    Attributes:
        scenario: the nominal one; it has a place for every quantity.
        quantities: uncertain quantities in the order of the coordinates.
        groups: groups of correlated quantities; no quantity is in two.

    Raises:
        ValueError: a path leads nowhere, a name occurs twice, or a correlation is none.
    """

    scenario: Scenario
    quantities: tuple[Quantity, ...]
    groups: tuple[Group, ...] = ()

    def __post_init__(self) -> None:
        names = [q.name for q in self.quantities]
        grouped = [name for group in self.groups for name in group.members]
        for listed in (names, [q.path for q in self.quantities], grouped):
            twice = sorted({name for name in listed if listed.count(name) > 1})
            if twice:
                raise ValueError(f"{twice[0]} is uncertain in two ways; keep one.")
        for quantity in self.quantities:
            look_up(self.scenario, quantity.path)
        for group in self.groups:
            correlated(
                np.full((1, len(group.members)), 0.5), np.array(group.correlation)
            )

    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(q.name for q in self.quantities)

    def has_chance(self) -> bool:
        """Whether anything is left to chance within a run: noise of sea or sensors."""
        parts = jax.tree.leaves(
            self.scenario.disturbance, is_leaf=lambda x: isinstance(x, GaussMarkov)
        )
        noisy = any(isinstance(part, GaussMarkov) for part in parts)
        sensing = self.scenario.sensors, self.scenario.instruments
        return noisy or any(sensors is not None for sensors in sensing)

    def values(self, coordinates: np.ndarray) -> np.ndarray:
        """Values of the quantities, one row a member.

        Args:
            coordinates: coordinates in (0, 1), one row a member, one column a quantity.
        """
        u = np.array(coordinates, np.float64)
        names = self.names()
        for group in self.groups:
            columns = [names.index(name) for name in group.members]
            u[:, columns] = correlated(u[:, columns], np.array(group.correlation))
        values = [q.values(u[:, j].copy()) for j, q in enumerate(self.quantities)]
        return np.stack(values, axis=1) if values else np.empty((len(u), 0))

    def members(self, values: np.ndarray, keys: jax.Array) -> Member:
        """An ensemble, in the precision of the scenario.

        Args:
            values: values of the quantities, one row a member.
            keys: random keys, one for each member.
        """
        kind = self.scenario.clock.dt.dtype
        columns = {
            q.path: jnp.asarray(values[:, j] - q.origin, kind)
            for j, q in enumerate(self.quantities)
        }
        return Member(columns, jr.key_data(keys))

    def sample(
        self, design: AbstractSampler, keys: jax.Array, first: int = 0
    ) -> Member:
        """Members `first`, `first + 1` and so on of a design, one for each key."""
        return self.members(self.values(design.rows(first, keys.shape[0])), keys)


def with_member(
    loop: ClosedLoop, member: Member
) -> tuple[ClosedLoop, BodyAxes[Series], SensorErrors | None]:
    """The closed loop of one member, its sea, and the errors of its sensors.

    They are the arguments of `simulate` and `evaluate`.

    Args:
        loop: closed loop.
        member: values of the uncertain quantities and a random key.
    """
    scenario = loop.scenario
    if member.values:
        scenario = eqx.tree_at(
            lambda at: [look_up(at, path) for path in member.values],
            scenario,
            list(member.values.values()),
            is_leaf=lambda leaf: leaf is None,
        )
    changed = dataclasses.replace(loop, scenario=scenario)
    sea, sensors = jr.split(jr.wrap_key_data(member.key))
    return changed, scenario.sea(sea), scenario.noise(sensors)


def look_up(scenario: Scenario, path: str) -> Any:
    """The end of a path: fields, keys and numbers, separated by dots.

    Args:
        scenario: scenario that the path begins in.
        path: dotted path, as `plant.parameters.drag`.

    Raises:
        ValueError: it leads nowhere.
    """
    place: Any = scenario
    for part in path.split("."):
        try:
            if isinstance(place, Mapping):
                place = place[part]
            elif isinstance(place, Sequence):
                place = place[int(part)]
            else:
                place = getattr(place, part)
        except (AttributeError, IndexError, KeyError, ValueError):
            raise ValueError(
                f"{path} is no number of this scenario: there is no {part!r} in "
                f"{type(place).__name__}."
            ) from None
    return place
