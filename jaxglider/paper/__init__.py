"""The study of Yang and Mahmoudian: cases, laws, tables, and gains tuned for it."""

from jaxglider.paper.cases import DESIGN_FACTOR as DESIGN_FACTOR
from jaxglider.paper.cases import DURATION as DURATION
from jaxglider.paper.cases import VEHICLE as VEHICLE
from jaxglider.paper.cases import attitude_schedule as attitude_schedule
from jaxglider.paper.cases import default_actuators as default_actuators
from jaxglider.paper.cases import design_model as design_model
from jaxglider.paper.cases import disturbance as disturbance
from jaxglider.paper.cases import guidance as guidance
from jaxglider.paper.cases import make_loop as make_loop
from jaxglider.paper.cases import make_scenario as make_scenario
from jaxglider.paper.cases import reference as reference
from jaxglider.paper.cases import specification as specification
from jaxglider.paper.cases import vertical_schedule as vertical_schedule
from jaxglider.paper.laws import CONTROLLERS as CONTROLLERS
from jaxglider.paper.laws import INVERSION as INVERSION
from jaxglider.paper.laws import ROLL_AWARE as ROLL_AWARE
from jaxglider.paper.laws import SCENARIOS as SCENARIOS
from jaxglider.paper.laws import fixed_time_observer as fixed_time_observer
from jaxglider.paper.laws import funnel as funnel
from jaxglider.paper.laws import make_controller as make_controller
from jaxglider.paper.laws import make_law as make_law
from jaxglider.paper.laws import make_observer as make_observer
from jaxglider.paper.tables import printed_tables as printed_tables
from jaxglider.paper.tables import printed_value as printed_value
from jaxglider.vehicle.plants import PLANTS as PLANTS
