"""Every estimator by its name, and the gains that each begins with.

The gains of the filter are what the noise of the sensors suggests; those of the
observers suit yos of a shallow Slocum, see `benchmarks/bench_estimators.py`.
"""

from collections.abc import Callable

import jax.numpy as jnp

from jaxglider.core.containers import Scalar, choose
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.navigation.fixed_time import FixedTimeStateObserver
from jaxglider.navigation.kalman import ModelAided
from jaxglider.navigation.linear import LinearObserver
from jaxglider.navigation.perfect import Perfect
from jaxglider.navigation.sensing.instrument import Instrument
from jaxglider.navigation.sensing.readings import Instruments, Sensed
from jaxglider.signals import map_fields
from jaxglider.vehicle.design_model import DesignModel

ESTIMATORS: dict[str, type[AbstractEstimator]] = {
    "perfect": Perfect,
    "model-aided": ModelAided,
    "fixed-time": FixedTimeStateObserver,
    "linear": LinearObserver,
}
"""All estimators by their names."""
DEFAULT = "model-aided"
"""Name of the estimator where nothing is said."""


def make_estimator(
    name: str, model: DesignModel, instruments: Instruments, steps: int = 1
) -> AbstractEstimator:
    """An estimator with the gains it begins with.

    Args:
        name: name of the estimator.
        model: design model.
        instruments: sensors that it reads.
        steps: integration steps of a filter in a tick.

    Raises:
        ValueError: an unknown name.
    """
    choose("estimator", name, tuple(ESTIMATORS))
    makers: dict[str, Callable[[], AbstractEstimator]] = {
        "perfect": Perfect,
        "model-aided": lambda: ModelAided(
            model,
            noise=map_fields(_deviation, instruments.sensed, Sensed(*_LEAST)),
            acceleration=0.0015,
            turning=0.002,
            mass_walk=0.002,
            drag_walk=0.002,
            moment_walk=0.02,
            zero=jnp.maximum(instruments.sensed.depth.bias_deviation, 1e-3),
            steps=steps,
        ),
        "fixed-time": lambda: FixedTimeStateObserver(
            model, near=_paced(0.12, instruments), far=_paced(0.03, instruments)
        ),
        "linear": lambda: LinearObserver(model, bandwidth=_paced(0.2, instruments)),
    }
    return makers[name]()


def usual_instruments() -> Instruments:
    """Sensors like those of most gliders, for gains of an estimator by themselves."""
    angle = Instrument(4.0, noise=0.005)
    compass = Instrument(4.0, noise=0.012)
    return Instruments(Sensed(Instrument(4.0, noise=0.05), angle, angle, compass))


_LEAST = 0.01, 0.001, 0.001, 0.003
"""Deviations that a filter takes sensors to have at least [m, rad]."""


def _deviation(sensor: Instrument, least: Scalar) -> Scalar:
    """Standard deviation of what a sensor says: its noise, and its rounding."""
    rounding = sensor.quantum**2 / 12.0
    return jnp.maximum(jnp.sqrt(sensor.noise**2 + rounding), least)


def _paced(depth: float, instruments: Instruments) -> Sensed[Scalar]:
    """Bandwidths [rad/s]: that of the depth, and of the attitude by its period."""
    attitude = map_fields(
        lambda sensor: jnp.minimum(1.0 / sensor.period, 1.0), instruments.sensed
    )
    return Sensed(depth, attitude.roll, attitude.pitch, attitude.heading)
