"""A tuning task put together: the closed loop, its free numbers, members, objective."""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from jaxglider import paper
from jaxglider._toml import ConfigError, Table, read_toml
from jaxglider.config import load_gains
from jaxglider.ensemble import map_members
from jaxglider.metrics import Metrics
from jaxglider.quantities import uniform_uncertainty
from jaxglider.rollout import ClosedLoop, evaluate
from jaxglider.vehicle.plant import SmallAnglePlant
from tuning.members import (
    TEST,
    TRAINING,
    VALIDATION,
    Member,
    nominal_member,
    sample_members,
    with_member,
)
from tuning.objective import Aggregate, Objective, Weights
from tuning.space import Space

DEFAULT_FREE = {
    "fxtppc": ("controller.gains.*.k1", "controller.gains.*.k2"),
    "ppc": ("controller.l0", "controller.l1_margin", "controller.l2"),
    "smc": ("controller.c0", "controller.c1", "controller.c2"),
}
"""Which numbers are tuned where the user does not say."""

DEFAULT_WEIGHTS = Weights(tracking=1.0, chattering=0.005, crowding=20.0, roll=5.0)
"""Tracking first; the rest keeps it in the funnel, upright, and off the buzzer."""


@dataclasses.dataclass(frozen=True)
class Task:
    """Everything a tuning run needs.

    Attributes:
        kind: of the controller.
        loop: the closed loop with the gains as given.
        space: which numbers are free.
        objective: the cost of one rollout.
        aggregate: how members' costs become one.
        training: members to descend on.
        validation: members to choose by.
        test: members for the verdict alone.
    """

    kind: str
    loop: ClosedLoop
    space: Space
    objective: Objective
    aggregate: Aggregate
    training: Member
    validation: Member
    test: Member

    def loss(self, free: Any, member: Member) -> Any:
        """The objective of free numbers on one member; pure."""
        return self.objective(self.metrics(free, member))

    def metrics(self, free: Any, member: Member) -> Metrics:
        """The metrics of free numbers on one member; pure."""
        return evaluate(*with_member(self.space.write(self.loop, free), member))

    def on_members(self) -> Callable[[ClosedLoop, Member], Metrics]:
        """Compiled: the metrics of a closed loop on each of some members."""

        def run(loop: ClosedLoop, members: Member) -> Metrics:
            return map_members(lambda m: evaluate(*with_member(loop, m)), members)

        return jax.jit(run)


def build_task(options: argparse.Namespace) -> Task:
    """A task from the options of the command line.

    Raises:
        ValueError: an option or a file cannot be used.
        FloatingPointError: the starting gains do not complete the nominal run.
    """
    kind, loop = _starting_loop(options)
    weights, aggregate = read_objective(options.objective)
    if options.aggregate:
        aggregate = dataclasses.replace(aggregate, kind=options.aggregate)
    paths = tuple(options.free) or DEFAULT_FREE[kind]
    constraints = () if options.unconstrained else ("k1-below-k2-squared",)
    space = Space.of(loop, paths, constraints)
    uncertainty = uniform_uncertainty(
        loop.scenario, options.uncertainty, options.amplitude, options.position
    )

    def draw(which: int, count: int) -> Member:
        if options.members == 1:
            return nominal_member(loop)
        return sample_members(uncertainty, options.seed, which, count)

    sets = (
        draw(TRAINING, options.members),
        draw(VALIDATION, options.validation),
        draw(TEST, options.test),
    )
    start = jax.jit(evaluate)(*with_member(loop, _first(nominal_member(loop))))
    if not bool(start.finite):
        raise FloatingPointError(
            "the starting gains do not complete the nominal run; start from others "
            "(--gains)."
        )
    return Task(kind, loop, space, Objective(start, weights), aggregate, *sets)


def read_objective(path: Path | None) -> tuple[Weights, Aggregate]:
    """Weights and aggregation from a TOML file, or the defaults.

    Raises:
        ConfigError: names the file, the key and the rule.
    """
    if path is None:
        return DEFAULT_WEIGHTS, Aggregate()
    try:
        top = Table(read_toml(path), "")
        parts = []
        for key, default in (("weights", DEFAULT_WEIGHTS), ("aggregate", Aggregate())):
            table = top.table(key)
            values: dict[str, Any] = {}
            for field in dataclasses.fields(default):
                name = "roll_limit_rad" if field.name == "roll_limit" else field.name
                old = getattr(default, field.name)
                read = table.text if isinstance(old, str) else table.number
                values[field.name] = read(name, old)
            table.close()
            parts.append(_built(type(default), key, values))
        top.close()
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if str(path) in text else f"{path}: {text}") from error
    return parts[0], parts[1]


def _built(kind: type, key: str, values: dict[str, Any]) -> Any:
    try:
        return kind(**values)
    except ValueError as error:
        raise ConfigError(f"{key}: {error}") from error


def _starting_loop(options: argparse.Namespace) -> tuple[str, ClosedLoop]:
    setting = paper.make_scenario(
        options.scenario, options.plant, dt=options.dt, duration=options.duration
    )
    assert isinstance(setting.plant, SmallAnglePlant)
    model = paper.design_model(setting.plant)
    if options.gains is not None:
        kind, controller, observer = load_gains(options.gains, options.scenario, model)
        if options.controller not in (None, kind):
            raise ValueError(
                f"--controller is {options.controller}, "
                f"but {options.gains} holds {kind}."
            )
        return kind, ClosedLoop(setting, controller, observer)
    kind = options.controller or "fxtppc"
    controller = paper.make_controller(kind, options.scenario, model)
    return kind, ClosedLoop(setting, controller, paper.make_observer(kind, model))


def _first(members: Member) -> Member:
    return jax.tree.map(lambda x: x[0], members)
