"""One channel's funnel as free numbers, inside the specified one whatever they are."""

from collections.abc import Callable, Collection
from operator import attrgetter
from typing import Any

import jax.numpy as jnp

from jaxglider.control.prescribed.performance import HalfSechFunction
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.specification import (
    FunnelBounds,
    Specification,
    bounds_of_a_funnel_inside,
    falling_part,
    initial_of,
)
from tuning.space.bijections import Above, Below, Bijection, Within
from tuning.space.coordinate import Coordinate
from tuning.space.edges import Edge

INSIDE = "inside-specification"
RESTART = "restart-inside"

_SLACK = 1e-6
"""Share by which rounding may miss an edge that another number gives."""
_MOVED = (
    "The funnel begins just inside of what is specified: {paths} start at its edge or "
    "outside."
)
_CAP = 20.0
"""Largest P₀: sech(20) is 4e-9."""


def _fixed(edge: float, rule: str, *, above: bool = False) -> Edge:
    """An edge that depends on no other gain."""
    if above:
        return Edge(lambda *_: edge, rule, lambda x, *_: x >= edge, _MOVED)
    return Edge(lambda *_: edge, rule, lambda x, *_: 0.0 < x <= edge, _MOVED)


class FunnelBox:
    """The coordinates of one channel's funnel, inside what is specified."""

    def __init__(
        self,
        loop: ClosedLoop,
        base: str,
        channel: str,
        specification: Specification,
        names: Collection[str],
        jump: float,
    ) -> None:
        performance = f"{base}.performance.{channel}"
        edges = f"{base}.transformation.{channel}"
        specified = getattr(specification.funnel.performance, channel)
        allowed = getattr(specification.funnel.transformation, channel)
        self.notes: list[str] = []
        self._names, self._loop, self._channel = names, loop, channel
        self._form = type(attrgetter(performance)(loop))
        self._bounds = bounds_of_a_funnel_inside(self._form, specified)
        numbers = ("initial", "final_bound", "settling_time")
        self._path = {name: f"{performance}.{name}" for name in numbers}
        self._path |= {side: f"{edges}.{side}" for side in ("lower", "upper")}
        self._delta = {s: float(getattr(allowed, s)) for s in ("lower", "upper")}
        self._jump = jump
        self._rule = f"P(t) at most the specified P(t) of {channel}"

    def coordinates(self) -> dict[str, Coordinate]:
        """Coordinates of the tuned numbers, by path."""
        box = self._bounds
        if box is None:
            self.notes.append(
                f"{INSIDE}: no {self._form.__name__} of {self._channel} is known to be "
                "inside the specified one; it is not held there. Take its form."
            )
            return {}
        self._say_what_is_fixed_outside(box)
        if self._jump > 0.0 and not self._has_room(box):
            self.notes.append(
                f"{RESTART}: a {self._form.__name__} inside what is specified for "
                f"{self._channel} starts below {self._jump:.3g}, the jump of its "
                "reference at a restart: the error will be outside there, whatever the "
                "gains. Widen [funnel], or turn in smaller steps."
            )
            self._jump = 0.0
        makers: dict[str, Callable[[FunnelBounds], tuple[Bijection, Edge, Any]]] = {
            "settling_time": lambda b: (
                Below(),
                _fixed(b.settling_time, self._rule),
                (),
            ),
            "final_bound": self._final_bound,
            "initial": self._initial,
            "lower": lambda b: self._side("lower"),
            "upper": lambda b: self._side("upper"),
        }
        return {
            self._path[name]: Coordinate(self._path[name], *make(box))
            for name, make in makers.items()
            if self._path[name] in self._names
        }

    def _value(self, name: str) -> float:
        return float(attrgetter(self._path[name])(self._loop))

    def _tuned(self, name: str) -> bool:
        return self._path[name] in self._names

    def _widest(self) -> float:
        """The largest δ that both edges can have."""
        return min(
            self._delta[s] if self._tuned(s) else self._value(s)
            for s in ("lower", "upper")
        )

    def _largest_fall(self, box: FunnelBounds) -> float:
        """The largest P(0) − P_∞ of the box, or that of a fixed P₀."""
        widest = box.initial.low if self._form is HalfSechFunction else box.initial.high
        at = widest if self._tuned("initial") else self._value("initial")
        return float(falling_part(self._form, jnp.asarray(at)))

    def _has_room(self, box: FunnelBounds) -> bool:
        tuned = self._tuned("final_bound")
        bound = box.final_bound if tuned else self._value("final_bound")
        start = self._largest_fall(box) + 0.98 * bound
        return self._jump < 0.98 * self._widest() * start

    def _final_bound(self, box: FunnelBounds) -> tuple[Bijection, Edge, Any]:
        high, rule = box.final_bound, self._rule
        low = self._jump / self._widest() - self._largest_fall(box)
        if self._jump == 0.0 or low <= 0.0:
            return Below(), _fixed(high, rule), ()
        rule += f", and P(0) at least the jump {self._jump:.3g} at a restart"
        ends = (low * (1.0 + 1e-3), high)
        return (
            Within(),
            Edge(lambda *_: ends, rule, lambda x, *_: low <= x <= high, _MOVED),
            (),
        )

    def _initial(self, box: FunnelBounds) -> tuple[Bijection, Edge, Any]:
        span, rule, form = box.initial, self._rule, self._form
        low, high = span.low, min(span.high, _CAP)
        if self._jump == 0.0:
            if form is HalfSechFunction:
                return Above(), _fixed(low, rule, above=True), ()
            if low == 0.0:
                return Below(), _fixed(high, rule), ()
            return (
                Within(),
                Edge(
                    lambda *_: (low, high), rule, lambda x, *_: low <= x <= high, _MOVED
                ),
                (),
            )
        needed, widest = self._jump, self._widest()

        def ends(bound: Any) -> tuple[Any, Any]:
            edge = initial_of(form, needed / widest - bound)
            if form is HalfSechFunction:
                return low, jnp.minimum(edge, high)
            return jnp.maximum(edge, low), high

        def holds(x: float, bound: float) -> bool:
            start = float(falling_part(form, jnp.asarray(x))) + bound
            return low <= x <= high and widest * start >= needed * (1.0 - _SLACK)

        rule += f", and P(0) at least the jump {needed:.3g} at a restart"
        return Within(), Edge(ends, rule, holds, _MOVED), (self._path["final_bound"],)

    def _side(self, side: str) -> tuple[Bijection, Edge, Any]:
        high, needed, form = self._delta[side], self._jump, self._form
        rule = f"at most the specified edge of {self._channel}"
        if needed == 0.0:
            return Below(), _fixed(high, rule), ()

        def ends(initial: Any, bound: Any) -> tuple[Any, Any]:
            return needed / (falling_part(form, initial) + bound), high

        def holds(x: float, initial: float, bound: float) -> bool:
            start = float(falling_part(form, jnp.asarray(initial))) + bound
            return x <= high and x * start >= needed * (1.0 - _SLACK)

        rule += f", times P(0) at least the jump {needed:.3g} at a restart"
        partners = (self._path["initial"], self._path["final_bound"])
        return Within(), Edge(ends, rule, holds, _MOVED), partners

    def _say_what_is_fixed_outside(self, box: FunnelBounds) -> None:
        limits = {
            "initial": box.initial.holds,
            "final_bound": lambda x: x <= box.final_bound,
            "settling_time": lambda x: x <= box.settling_time,
            "lower": lambda x: x <= self._delta["lower"],
            "upper": lambda x: x <= self._delta["upper"],
        }
        for name, holds in limits.items():
            if not self._tuned(name) and not holds(self._value(name)):
                self.notes.append(
                    f"{INSIDE}: {self._path[name]} = {self._value(name):g} is outside "
                    "what is specified and is not tuned: it stays there."
                )
