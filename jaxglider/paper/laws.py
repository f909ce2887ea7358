"""The laws and gains of the paper, and FxTPPC-roll around them."""

import math
from typing import Any

from jaxglider.control import (
    PPC,
    SMC,
    AbstractController,
    ChannelGains,
    Funnel,
    FxTPPC,
    RollAwareFxTPPC,
)
from jaxglider.control.fxtppc import paper_exponents
from jaxglider.control.observer import AbstractObserver, FixedTimeObserver, NoObserver
from jaxglider.control.performance import (
    AbstractPerformanceFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.transform import ErrorTransformation
from jaxglider.core.containers import choose
from jaxglider.signals import BodyAxes, Channels
from jaxglider.vehicle.design_model import DesignModel

SCENARIOS = ("switching", "waypoints")
"""The paper's two cases: switching attitudes, and a course of waypoints."""

CONTROLLERS = ("smc", "ppc", "fxtppc")

ROLL_AWARE = "fxtppc-roll"
"""The third law made aware of the roll; not the paper's."""


_FUNNELS = {
    # scenario: channel: P_0, P_inf, T
    "switching": {
        "depth": (1.0, 0.2, 100.0),
        "pitch": (5 * math.pi / 18, math.pi / 18, 80.0),
        "heading": (5 * math.pi / 18, math.pi / 12, 100.0),
    },
    "waypoints": {
        "depth": (1.0, 0.5, 100.0),
        "pitch": (5 * math.pi / 18, math.pi / 18, 80.0),
        "heading": (5 * math.pi / 18, 2 * math.pi / 45, 60.0),
    },
}


def funnel(
    scenario: str, form: type[AbstractPerformanceFunction] = SechFunction
) -> Funnel:
    """The performance functions of a case, symmetric, in one of the forms.

    Args:
        scenario: `switching` or `waypoints`.
        form: class of the performance functions.
    """
    performance = {
        channel: form(*numbers) for channel, numbers in _FUNNELS[scenario].items()
    }
    return Funnel(Channels(**performance), _on_each(ErrorTransformation()))


def make_controller(name: str, scenario: str, model: DesignModel) -> AbstractController:
    """One of the three controllers with the paper's gains, or `fxtppc-roll`.

    The funnel of `smc` only serves to judge it by the same bounds.

    Args:
        name: name of the controller.
        scenario: `switching` or `waypoints`.
        model: design model.

    Raises:
        ValueError: an unknown name.
    """
    choose("controller", name, (*CONTROLLERS, ROLL_AWARE))
    choose("scenario", scenario, SCENARIOS)
    if name == "smc":
        return SMC(
            model,
            c0=Channels(0.1, 0.1, 0.1),
            c1=Channels(1.0, 1.0, 1.0),
            c2=Channels(5.0, 5.0, 5.0),
            funnel=funnel(scenario),
        )
    if name == "ppc":
        return PPC(
            model,
            funnel(scenario, HalfSechFunction),
            l0=Channels(0.1, 0.1, 0.1),
            l1_margin=Channels(0.1, 0.1, 0.1),
            l2=Channels(1.0, 1.0, 3.0),
        )
    law = FxTPPC(
        model,
        funnel(scenario),
        Channels(
            ChannelGains(0.001, 0.01),
            ChannelGains(0.01, 0.2),
            ChannelGains(0.001, 0.08),
        ),
        exponents=paper_exponents,
    )
    return law if name == "fxtppc" else RollAwareFxTPPC(law)


def fixed_time_observer(model: DesignModel) -> FixedTimeObserver:
    """The observer with the paper's gains."""
    return FixedTimeObserver(
        model,
        proportional=BodyAxes(0.001, 0.001, 0.01, 0.01, 0.01, 0.01),
        integral=BodyAxes(0.01, 0.01, 0.1, 0.1, 0.1, 0.1),
        stretch=BodyAxes(18.0, 18.0, 18.0, 180.0, 180.0, 180.0),
    )


def make_observer(controller: str, model: DesignModel) -> AbstractObserver:
    """The observer the paper gives a controller: none for `smc`.

    Args:
        controller: name of the controller.
        model: design model.
    """
    return NoObserver() if controller == "smc" else fixed_time_observer(model)


def _on_each(thing: Any) -> Channels[Any]:
    return Channels(thing, thing, thing)
