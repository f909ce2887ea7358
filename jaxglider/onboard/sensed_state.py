"""Memory of an autopilot on sensors, and what its sensors tell it at a tick."""

from typing import Any, NamedTuple

import equinox as eqx

from jaxglider.core.containers import Flag, Scalar
from jaxglider.navigation.sensing.altimeter import AltimeterState
from jaxglider.navigation.sensing.readings import Readings, Sensed
from jaxglider.onboard.autopilot import AutopilotState
from jaxglider.signals import Command


class SensedState(eqx.Module):
    """State between two ticks on board.

    Attributes:
        pilot: state of the autopilot.
        earlier: positions of the actuators at the start of the last tick [kg, m, rad].
        begun: flag, every sensor has given a good sample.
        heard: flag, none of the sensors had been silent for too long.
        stamps: times of the newest samples [s].
        shown: last good numbers [m, rad].
        silent: times since the last good samples [s].
        estimator: state of the estimator.
        reckoning: belief of place.
        echoes: last echoes, or None without an altimeter.
        echo_stamp: time of the newest echo [s].
        fix_stamp: time of the newest fix [s].
    """

    pilot: AutopilotState
    earlier: Command[Scalar]
    begun: Flag
    heard: Flag
    stamps: Sensed[Scalar]
    shown: Sensed[Scalar]
    silent: Sensed[Scalar]
    estimator: Any
    reckoning: Any
    echoes: AltimeterState | None
    echo_stamp: Scalar
    fix_stamp: Scalar

    @property
    def reference(self) -> Any:
        """State of the reference."""
        return self.pilot.reference


class Heard(NamedTuple):
    """Depth and attitude as the sensors tell them at a tick.

    Attributes:
        readings: readings for the estimator.
        stamps: times of the newest samples [s].
        shown: last good numbers [m, rad].
        silent: times since the last good samples [s].
        all: flag, none of the sensors has been silent for too long.
        refused: flag, a sample was refused.
    """

    readings: Readings
    stamps: Sensed[Scalar]
    shown: Sensed[Scalar]
    silent: Sensed[Scalar]
    all: Flag
    refused: Flag
