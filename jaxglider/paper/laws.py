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
from jaxglider.control.prescribed.performance import (
    AbstractPerformanceFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.prescribed.transform import ErrorTransformation
from jaxglider.control.steering import INVERSION, AbstractSteering, BankSteering
from jaxglider.core.containers import choose
from jaxglider.signals import BodyAxes, Channels
from jaxglider.simulation.gains import LoadedGains
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.moving_mass import FinActuation, PrintedActuation

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


def default_steering(model: DesignModel) -> AbstractSteering:
    """The way to steer where nothing is said.

    The paper's for the paper's glider, which rolls away from its mass, and for one with
    a fin; by bank for one whose mass obeys mechanics, which the paper's loses in a
    climb.

    Args:
        model: design model.
    """
    if isinstance(model.actuation, PrintedActuation | FinActuation):
        return INVERSION
    return BankSteering()


def _smc(scenario: str, model: DesignModel, steering: AbstractSteering) -> SMC:
    """Its funnel only serves to judge it by the same bounds."""
    if isinstance(steering, BankSteering):
        c0, c1 = Channels(0.05, 0.1, 0.05), Channels(0.2, 0.3, 0.1)
        c2 = Channels(0.002, 0.002, 0.002)
    else:
        c0, c1 = Channels(0.1, 0.1, 0.1), Channels(1.0, 1.0, 1.0)
        c2 = Channels(5.0, 5.0, 5.0)
    return SMC(model, c0, c1, c2, funnel=funnel(scenario), steering=steering)


def _ppc(scenario: str, model: DesignModel, steering: AbstractSteering) -> PPC:
    if isinstance(steering, BankSteering):
        l0, margin = Channels(0.05, 0.1, 0.03), Channels(0.05, 0.1, 0.1)
        l2 = Channels(0.002, 0.01, 0.002)
    else:
        l0, margin = Channels(0.1, 0.1, 0.1), Channels(0.1, 0.1, 0.1)
        l2 = Channels(1.0, 1.0, 3.0)
    bounds = funnel(scenario, HalfSechFunction)
    return PPC(model, bounds, l0=l0, l1_margin=margin, l2=l2, steering=steering)


def _fxtppc(scenario: str, model: DesignModel, steering: AbstractSteering) -> FxTPPC:
    if isinstance(steering, BankSteering):
        # A larger mu, or rho, is softer about zero.
        gains = Channels(
            ChannelGains(0.001, 0.05, mu=4.0),
            ChannelGains(0.02, 0.17, rho=0.9, mu=8.0),
            ChannelGains(0.002, 0.08, rho=0.9, mu=6.5),
        )
        hedging = 0.5
    else:
        gains = Channels(
            ChannelGains(0.001, 0.01),
            ChannelGains(0.01, 0.2),
            ChannelGains(0.001, 0.08),
        )
        hedging = None
    return FxTPPC(
        model,
        funnel(scenario),
        gains,
        exponents=paper_exponents,
        steering=steering,
        hedging=hedging,
    )


def _fxtppc_roll(
    scenario: str, model: DesignModel, steering: AbstractSteering
) -> RollAwareFxTPPC:
    """Around the paper's inversion alone: steering by bank knows of the roll itself."""
    return RollAwareFxTPPC(_fxtppc(scenario, model, INVERSION))


_MAKERS: dict[
    str, Callable[[str, DesignModel, AbstractSteering], AbstractController]
] = {
    "smc": _smc,
    "ppc": _ppc,
    "fxtppc": _fxtppc,
    "fxtppc-roll": _fxtppc_roll,
}


def make_controller(
    name: str,
    scenario: str,
    model: DesignModel,
    steering: AbstractSteering | None = None,
) -> AbstractController:
    """A law with the gains it begins with: the paper's where it inverts.

    A law that steers by bank begins with gains of its own: the paper's for the heading
    mean nothing there, and its others chatter against actuators that have a speed.

    Args:
        name: name of the law in the catalogue; `fxtppc-roll` has those of `fxtppc`, and
            defaults of its own for the roll. A law that is not the paper's says itself
            what it begins with.
        scenario: `switching` or `waypoints`.
        model: design model.
        steering: way to steer; `default_steering` by default.

    Raises:
        ValueError: an unknown name.
    """
    choose("controller", name, tuple(BY_NAME))
    choose("scenario", scenario, SCENARIOS)
    steering = steering or default_steering(model)
    if name in _MAKERS:
        return _MAKERS[name](scenario, model, steering)
    cls: Any = BY_NAME[name].cls
    law: AbstractController = cls.initial(model, funnel(scenario), steering)
    return law


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


def make_law(
    name: str,
    scenario: str,
    model: DesignModel,
    steering: AbstractSteering | None = None,
) -> LoadedGains:
    """A law with the gains it begins with, and the observer the paper gives it.

    Args:
        name: name of the law in the catalogue.
        scenario: `switching` or `waypoints`.
        model: design model.
        steering: way to steer; `default_steering` by default.

    Raises:
        ValueError: an unknown name.
    """
    controller = make_controller(name, scenario, model, steering)
    observer = make_observer(BY_NAME[name].observer, model)
    return LoadedGains(name, controller, observer)


def _on_each(thing: Any) -> Channels[Any]:
    return Channels(thing, thing, thing)
