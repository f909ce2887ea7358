"""The laws and gains of the paper, and FxTPPC-roll around them."""

import math
from collections.abc import Callable
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
from jaxglider.control.catalogue import BY_NAME
from jaxglider.control.fxtppc import paper_exponents
from jaxglider.control.observer import AbstractObserver, FixedTimeObserver, NoObserver
from jaxglider.control.performance import (
    AbstractPerformanceFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.slocum import Slocum
from jaxglider.control.transform import ErrorTransformation
from jaxglider.core.containers import choose
from jaxglider.signals import BodyAxes, Channels
from jaxglider.simulation.gains import LoadedGains
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.moving_mass import FinActuation

SCENARIOS = ("switching", "waypoints")
"""The paper's two cases: switching attitudes, and a course of waypoints."""

CONTROLLERS = ("smc", "ppc", "fxtppc")
"""The paper's own laws."""

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


def _smc(scenario: str, model: DesignModel) -> SMC:
    """Its funnel only serves to judge it by the same bounds."""
    return SMC(
        model,
        c0=Channels(0.1, 0.1, 0.1),
        c1=Channels(1.0, 1.0, 1.0),
        c2=Channels(5.0, 5.0, 5.0),
        funnel=funnel(scenario),
    )


def _ppc(scenario: str, model: DesignModel) -> PPC:
    return PPC(
        model,
        funnel(scenario, HalfSechFunction),
        l0=Channels(0.1, 0.1, 0.1),
        l1_margin=Channels(0.1, 0.1, 0.1),
        l2=Channels(1.0, 1.0, 3.0),
    )


def _fxtppc(scenario: str, model: DesignModel) -> FxTPPC:
    return FxTPPC(
        model,
        funnel(scenario),
        Channels(
            ChannelGains(0.001, 0.01),
            ChannelGains(0.01, 0.2),
            ChannelGains(0.001, 0.08),
        ),
        exponents=paper_exponents,
    )


def _fxtppc_roll(scenario: str, model: DesignModel) -> RollAwareFxTPPC:
    return RollAwareFxTPPC(_fxtppc(scenario, model))


def _slocum(scenario: str, model: DesignModel) -> Slocum:
    """Not the paper's; its funnel only serves to judge it by the same bounds."""
    turns_mass = not isinstance(model.actuation, FinActuation)
    sign = -1.0 if turns_mass else 1.0
    return Slocum(model, funnel=funnel(scenario), climb_sign=sign)


_WITH_PAPER_GAINS: dict[str, Callable[[str, DesignModel], AbstractController]] = {
    "smc": _smc,
    "ppc": _ppc,
    "fxtppc": _fxtppc,
    "fxtppc-roll": _fxtppc_roll,
    "slocum": _slocum,
}


def make_controller(name: str, scenario: str, model: DesignModel) -> AbstractController:
    """A law with the paper's gains.

    Args:
        name: name of the law in the catalogue; `fxtppc-roll` has those of `fxtppc`, and
            defaults of its own for the roll.
        scenario: `switching` or `waypoints`.
        model: design model.

    Raises:
        ValueError: an unknown name.
    """
    choose("controller", name, tuple(_WITH_PAPER_GAINS))
    choose("scenario", scenario, SCENARIOS)
    return _WITH_PAPER_GAINS[name](scenario, model)


def fixed_time_observer(model: DesignModel) -> FixedTimeObserver:
    """The observer with the paper's gains."""
    return FixedTimeObserver(
        model,
        proportional=BodyAxes(0.001, 0.001, 0.01, 0.01, 0.01, 0.01),
        integral=BodyAxes(0.01, 0.01, 0.1, 0.1, 0.1, 0.1),
        stretch=BodyAxes(18.0, 18.0, 18.0, 180.0, 180.0, 180.0),
    )


_OBSERVERS: dict[str, Callable[[DesignModel], AbstractObserver]] = {
    "none": lambda model: NoObserver(),
    "fixed-time": fixed_time_observer,
}


def make_observer(name: str, model: DesignModel) -> AbstractObserver:
    """An observer with the paper's gains.

    Args:
        name: name of the observer in the catalogue, `none` or `fixed-time`.
        model: design model.

    Raises:
        ValueError: an unknown name.
    """
    choose("observer", name, tuple(_OBSERVERS))
    return _OBSERVERS[name](model)


def make_law(name: str, scenario: str, model: DesignModel) -> LoadedGains:
    """A law with the paper's gains, and the observer the paper gives it.

    Args:
        name: name of the law in the catalogue.
        scenario: `switching` or `waypoints`.
        model: design model.

    Raises:
        ValueError: an unknown name.
    """
    controller = make_controller(name, scenario, model)
    observer = make_observer(BY_NAME[name].observer, model)
    return LoadedGains(name, controller, observer)


def _on_each(thing: Any) -> Channels[Any]:
    return Channels(thing, thing, thing)
