"""The catalogue: every law, observer, performance function and steering by its name.

A new law is a file of its own and a line here. Whatever lists laws reads it: files,
command line, tables, figures, and the tests of the contract that every law keeps.
"""

import dataclasses

from jaxglider.control.controller import AbstractController
from jaxglider.control.flown.seaexplorer import SeaExplorer
from jaxglider.control.flown.seaglider import Seaglider
from jaxglider.control.flown.slocum import Slocum
from jaxglider.control.fxtppc import FxTPPC
from jaxglider.control.fxtppc_roll import RollAwareFxTPPC
from jaxglider.control.observer import AbstractObserver, FixedTimeObserver, NoObserver
from jaxglider.control.ppc import PPC
from jaxglider.control.prescribed.performance import (
    AbstractPerformanceFunction,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.smc import SMC
from jaxglider.control.steering import AbstractSteering, BankSteering, Inversion
from jaxglider.control.textbook.adrc import ADRC
from jaxglider.control.textbook.backstepping import Backstepping
from jaxglider.control.textbook.fixed_time import FixedTimeBackstepping
from jaxglider.control.textbook.lqr import LQI, LQR
from jaxglider.control.textbook.mpc import MPC
from jaxglider.control.textbook.pid import PID


@dataclasses.dataclass(frozen=True)
class LawEntry:
    """A control law as it is listed.

    Attributes:
        name: word for it in files and on the command line.
        cls: class of the law.
        label: name for tables and figures.
        observer: name of the observer it flies with where nothing else is asked for.
    """

    name: str
    cls: type[AbstractController]
    label: str
    observer: str = "fixed-time"


LAWS = (
    LawEntry("smc", SMC, "SMC", observer="none"),
    LawEntry("ppc", PPC, "PPC"),
    LawEntry("fxtppc", FxTPPC, "FxTPPC"),
    LawEntry("fxtppc-roll", RollAwareFxTPPC, "FxTPPC-roll"),
    LawEntry("slocum", Slocum, "Slocum", observer="none"),
    LawEntry("seaglider", Seaglider, "Seaglider", observer="none"),
    LawEntry("seaexplorer", SeaExplorer, "SeaExplorer", observer="none"),
    LawEntry("pid", PID, "PID", observer="none"),
    LawEntry("lqr", LQR, "LQR", observer="none"),
    LawEntry("lqi", LQI, "LQI", observer="none"),
    LawEntry("mpc", MPC, "MPC", observer="none"),
    LawEntry("adrc", ADRC, "ADRC", observer="none"),
    LawEntry("backstepping", Backstepping, "Backstepping", observer="none"),
    LawEntry("fixed-time-backstepping", FixedTimeBackstepping, "FxT-backstepping"),
)
"""All laws, the paper's three first."""

BY_NAME: dict[str, LawEntry] = {entry.name: entry for entry in LAWS}

OBSERVERS: dict[str, type[AbstractObserver]] = {
    "none": NoObserver,
    "fixed-time": FixedTimeObserver,
}

PERFORMANCE_FUNCTIONS: dict[str, type[AbstractPerformanceFunction]] = {
    "sech": SechFunction,
    "exponential": ExponentialFunction,
    "ppc": HalfSechFunction,
}

STEERINGS: dict[str, type[AbstractSteering]] = {
    "inversion": Inversion,
    "bank": BankSteering,
}
