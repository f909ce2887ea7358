"""The numbers of a closed loop of jaxglider as plain arrays, which every peer takes."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider import ClosedLoop, Metrics
from jaxglider.uncertainty.sampling import MonteCarlo
from jaxglider.vehicle.parameters import UNCERTAIN

SPREAD = 0.2
"""Half width of every uncertain parameter of the members."""

CHANNELS = ("depth", "pitch", "heading")
CHANNEL_METRICS = (
    "rms_error",
    "rms_effort",
    "chattering",
    "max_error",
    "max_error_settled",
    "time_outside_funnel",
    "time_saturated",
    "funnel_crowding",
    "saturation_excess",
)
METRICS = (
    *(f"{channel}.{name}" for channel in CHANNELS for name in CHANNEL_METRICS),
    "max_roll",
    "max_pitch",
    "finite",
)


@dataclasses.dataclass(frozen=True)
class Problem:
    """What all members share. Arrays over channels, axes, parameters or segments.

    Attributes:
        shared: by name, in the order of `struct shared` in closed_loop.c.
        schedule: start, gliding angle, heading and depth rate of each segment.
        sea: τ_d at every tick, shape (6, ticks + 1).
    """

    shared: dict[str, np.ndarray]
    schedule: dict[str, np.ndarray]
    sea: np.ndarray

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["shared"][name]
        except KeyError:
            raise AttributeError(name) from None

    @classmethod
    def of(cls, loop: ClosedLoop, sea: Any, kind: type) -> "Problem":
        """The numbers of a loop and a sea in one precision.

        Args:
            loop: FxTPPC on the printed plant, following an attitude schedule.
            sea: the realised disturbance.
            kind: np.float32 or np.float64.
        """
        controller, observer = loop.controller, loop.observer
        scenario = loop.scenario
        gains, funnel = controller.gains, controller.funnel

        def column(things: Any, name: str) -> list[Any]:
            return [getattr(thing, name) for thing in vars(things).values()]

        shared = {
            "design": list(vars(controller.model.parameters).values()),
            "start": list(vars(scenario.initial_state).values()),
            "dt": [scenario.clock.dt],
            **{name: column(gains, name) for name in ("k1", "k2", "rho", "mu")},
            "damping": list(vars(controller.damping).values()),
            "smoothing": [controller.smoothing],
            **{
                name: column(funnel.performance, name)
                for name in ("initial", "final_bound", "settling_time")
            },
            **{
                name: column(funnel.transformation, name)
                for name in ("lower", "upper", "tail")
            },
            **{
                name: list(vars(getattr(observer, name)).values())
                for name in ("proportional", "integral", "stretch")
            },
            "observer_smoothing": [observer.smoothing],
            "limit": column(scenario.actuators, "limit"),
        }
        schedule = vars(scenario.reference.schedule)
        names = ("start", "gliding_angle", "heading", "depth_rate")
        return cls(
            {name: np.asarray(values, kind) for name, values in shared.items()},
            {name: np.asarray(schedule[name], kind) for name in names},
            np.asarray(jax.device_get(sea.fields()), kind),
        )


def parameter_rows(parameters: Any, kind: type) -> np.ndarray:
    """GliderParameters of many members as an array (parameters, members)."""
    return np.asarray(jax.device_get(list(vars(parameters).values())), kind)


def metric_rows(metrics: Metrics) -> np.ndarray:
    """Metrics of many members as an array (len(METRICS), members)."""

    def row(name: str) -> np.ndarray:
        *channel, last = name.split(".")
        owner = getattr(metrics.channels, channel[0]) if channel else metrics
        return np.asarray(getattr(owner, last), float)

    return np.stack([row(name) for name in METRICS])


def draw_members(nominal: Any, count: int, precision: int) -> Any:
    """Parameters of `count` gliders: the same ones in either precision."""
    rows = MonteCarlo(0, UNCERTAIN).rows(0, count)
    factors = dict(zip(UNCERTAIN, 1.0 + SPREAD * (2.0 * rows.T - 1.0), strict=True))
    kind = np.float64 if precision == 64 else np.float32
    drawn = {
        name: jnp.asarray(float(value) * factors.get(name, np.ones(count)), kind)
        for name, value in vars(nominal).items()
    }
    return type(nominal)(**drawn)
