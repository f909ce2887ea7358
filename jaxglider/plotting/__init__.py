"""One function per figure: takes axes and data, returns the axes.

`save_all` makes them all, sized for a journal, and writes them. Host side: nothing
traced imports this. Angles are drawn in degrees, times in seconds, depth downward; the
ticks after the end of a mission are left out, and so is what is not finite. Long runs
are thinned for drawing, their extremes kept.
"""

from jaxglider.plotting.commands import commands as commands
from jaxglider.plotting.comparison import errors as errors
from jaxglider.plotting.comparison import tracking as tracking
from jaxglider.plotting.path import depth_over_distance as depth_over_distance
from jaxglider.plotting.path import path_3d as path_3d
from jaxglider.plotting.path import path_plan as path_plan
from jaxglider.plotting.performance import (
    performance_functions as performance_functions,
)
from jaxglider.plotting.save import figures as figures
from jaxglider.plotting.save import save_all as save_all
from jaxglider.plotting.vehicle import disturbance_estimate as disturbance_estimate
from jaxglider.plotting.vehicle import vehicle_state as vehicle_state
