"""Differentiable simulation, control and gain tuning of underwater gliders."""

from jaxglider.control import PPC as PPC
from jaxglider.control import SMC as SMC
from jaxglider.control import AbstractController as AbstractController
from jaxglider.control import BankSteering as BankSteering
from jaxglider.control import ChannelGains as ChannelGains
from jaxglider.control import ControlRecord as ControlRecord
from jaxglider.control import Funnel as Funnel
from jaxglider.control import FxTPPC as FxTPPC
from jaxglider.control import Inversion as Inversion
from jaxglider.control import RollAwareFxTPPC as RollAwareFxTPPC
from jaxglider.control.observer import FixedTimeObserver as FixedTimeObserver
from jaxglider.control.observer import NoObserver as NoObserver
from jaxglider.control.prescribed.transform import (
    ErrorTransformation as ErrorTransformation,
)
from jaxglider.core.batching import map_members as map_members
from jaxglider.core.batching import member_keys as member_keys
from jaxglider.core.compiler import enable_fast_loops as enable_fast_loops
from jaxglider.environment.disturbances import Calm as Calm
from jaxglider.environment.disturbances import Constant as Constant
from jaxglider.environment.disturbances import GaussMarkov as GaussMarkov
from jaxglider.environment.disturbances import Sinusoid as Sinusoid
from jaxglider.environment.disturbances import Sum as Sum
from jaxglider.environment.water import Current as Current
from jaxglider.environment.water import Stratification as Stratification
from jaxglider.environment.water import Water as Water
from jaxglider.guidance import AttitudeSchedule as AttitudeSchedule
from jaxglider.guidance import LineOfSight as LineOfSight
from jaxglider.guidance import Schedule as Schedule
from jaxglider.guidance import WaypointPath as WaypointPath
from jaxglider.navigation.catalogue import make_estimator as make_estimator
from jaxglider.navigation.fixed_time import (
    FixedTimeStateObserver as FixedTimeStateObserver,
)
from jaxglider.navigation.kalman import ModelAided as ModelAided
from jaxglider.navigation.linear import LinearObserver as LinearObserver
from jaxglider.navigation.perfect import Perfect as Perfect
from jaxglider.navigation.reckoning import Reckoning as Reckoning
from jaxglider.navigation.sensing.altimeter import Altimeter as Altimeter
from jaxglider.navigation.sensing.instrument import Compass as Compass
from jaxglider.navigation.sensing.instrument import Instrument as Instrument
from jaxglider.navigation.sensing.positioning import Positioning as Positioning
from jaxglider.navigation.sensing.readings import Instruments as Instruments
from jaxglider.navigation.sensing.readings import Sensed as Sensed
from jaxglider.signals import BodyAxes as BodyAxes
from jaxglider.signals import Channels as Channels
from jaxglider.signals import Command as Command
from jaxglider.signals import GliderState as GliderState
from jaxglider.simulation.closed_loop import ClosedLoop as ClosedLoop
from jaxglider.simulation.metrics import Metrics as Metrics
from jaxglider.simulation.rollout import Trajectory as Trajectory
from jaxglider.simulation.rollout import evaluate as evaluate
from jaxglider.simulation.rollout import simulate as simulate
from jaxglider.simulation.scenario import Clock as Clock
from jaxglider.simulation.scenario import Scenario as Scenario
from jaxglider.simulation.specification import Specification as Specification
from jaxglider.vehicle.actuators import Actuator as Actuator
from jaxglider.vehicle.design_model import DesignModel as DesignModel
from jaxglider.vehicle.full_plant import full_plant as full_plant
from jaxglider.vehicle.parameters import GliderParameters as GliderParameters
from jaxglider.vehicle.plant import printed_plant as printed_plant
from jaxglider.vehicle.plant import rigid_body_plant as rigid_body_plant
from jaxglider.vehicle.published import load_vehicle as load_vehicle
