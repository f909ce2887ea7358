"""The control laws, one protocol."""

from jaxglider.control.controller import AbstractController as AbstractController
from jaxglider.control.controller import ControlRecord as ControlRecord
from jaxglider.control.controller import allocate as allocate
from jaxglider.control.controller import tracking_error as tracking_error
from jaxglider.control.fxtppc import ChannelGains as ChannelGains
from jaxglider.control.fxtppc import FxTPPC as FxTPPC
from jaxglider.control.fxtppc import paper_exponents as paper_exponents
from jaxglider.control.fxtppc import tian_exponents as tian_exponents
from jaxglider.control.fxtppc_roll import RollAwareFxTPPC as RollAwareFxTPPC
from jaxglider.control.ppc import PPC as PPC
from jaxglider.control.prescribed.funnel import Funnel as Funnel
from jaxglider.control.smc import SMC as SMC
from jaxglider.control.steering import AbstractSteering as AbstractSteering
from jaxglider.control.steering import BankSteering as BankSteering
from jaxglider.control.steering import Inversion as Inversion
