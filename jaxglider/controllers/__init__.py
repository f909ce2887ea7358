"""The control laws, one protocol."""

from jaxglider.controllers.base import AbstractController as AbstractController
from jaxglider.controllers.base import ControlRecord as ControlRecord
from jaxglider.controllers.base import Funnel as Funnel
from jaxglider.controllers.base import allocate as allocate
from jaxglider.controllers.base import tracking_error as tracking_error
from jaxglider.controllers.fxtppc import ChannelGains as ChannelGains
from jaxglider.controllers.fxtppc import FxTPPC as FxTPPC
from jaxglider.controllers.fxtppc import paper_exponents as paper_exponents
from jaxglider.controllers.fxtppc import tian_exponents as tian_exponents
from jaxglider.controllers.ppc import PPC as PPC
from jaxglider.controllers.roll_aware import RollAwareFxTPPC as RollAwareFxTPPC
from jaxglider.controllers.smc import SMC as SMC
