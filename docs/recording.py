"""Flights in a file: what figures are drawn of, in single precision."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.control.prescribed.funnel import Limits
from jaxglider.navigation.navigator import OnBoard
from jaxglider.navigation.sensing.readings import Sensed
from jaxglider.signals import CHANNELS, BodyAxes, Channels, Command, GliderState
from jaxglider.simulation.metrics import empty_sums, finish
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord
from jaxglider.vehicle.energy import Consumers

_KINDS: dict[str, Any] = {
    "state": GliderState,
    **dict.fromkeys(("reference", "error", "surface"), Channels),
    **dict.fromkeys(("limits", "law_limits"), Channels),
    **dict.fromkeys(("wanted", "applied"), Command),
    **dict.fromkeys(("estimate", "lumped", "disturbance"), BodyAxes),
    "energy": Consumers,
}
_PAIRS = ("current", "fix")
"""What is known on board as north and east."""


def keep(path: Path, run: Trajectory) -> None:
    """Write a flight on the host."""
    np.savez_compressed(path, **dict(_columns("", run.ticks)))


def _columns(path: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Path and values of each column of a record; counts and flags as they are."""
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            inner = getattr(value, field.name)
            yield from _columns(f"{path}.{field.name}".strip("."), inner)
    elif isinstance(value, tuple):
        for number, inner in enumerate(value):
            yield from _columns(f"{path}.{number}", inner)
    elif value is not None:
        array = np.asarray(value)
        single = np.issubdtype(array.dtype, np.floating)
        yield path, array.astype(np.float32) if single else array


def kept(path: Path) -> Trajectory:
    """A flight as it was recorded; its metrics are empty."""
    with np.load(path) as file:
        columns = {key: jnp.asarray(value) for key, value in file.items()}
    ticks = jax.vmap(_tick)(columns)
    zero, start = jnp.zeros(()), GliderState.at_rest()
    metrics = finish(empty_sums(zero), start, jnp.asarray(0), zero + 1.0)
    return Trajectory(ticks, metrics)


def _tick(columns: dict[str, Any]) -> TickRecord:
    """One record from its columns by their paths."""
    numbers = {key: x for key, x in columns.items() if "." not in key}
    parts = {key: _part(key, columns) for key in _KINDS}
    onboard = _onboard(_below("onboard", columns))
    return TickRecord(**{"phase": None} | numbers | parts, onboard=onboard)


def _below(key: str, columns: Mapping[str, Any]) -> dict[str, Any]:
    """Columns of a part, by their paths within it."""
    start = f"{key}."
    return {k[len(start) :]: x for k, x in columns.items() if k.startswith(start)}


def _onboard(columns: Mapping[str, Any]) -> OnBoard | None:
    """What was known on board, where there were sensors."""
    if not columns:
        return None
    estimate, shown = (_below(key, columns) for key in ("estimate", "shown"))
    current, fix = ((columns[f"{key}.0"], columns[f"{key}.1"]) for key in _PAIRS)
    return OnBoard(GliderState(**estimate), Sensed(**shown), current, fix)


def _part(key: str, columns: Mapping[str, Any]) -> Any:
    """A container of a record."""
    own = _below(key, columns)
    if not own:
        return None
    if key.endswith("limits"):
        edges = {c: Limits(own[f"{c}.lower"], own[f"{c}.upper"]) for c in CHANNELS}
        return Channels(**edges)
    return _KINDS[key](**own)
