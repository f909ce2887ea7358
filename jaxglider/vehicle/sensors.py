"""Sensors: what a measurement adds to the truth, realised before the rollout starts.

x_measured = x + b + σ ξ_k on each state that has a sensor of its own here, with ξ_k
standard normal and independent from tick to tick. All other states are measured as
they are. Metrics judge the true state.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.random as jr

from jaxglider.core.containers import (
    Container,
    Scalar,
    Series,
    as_float,
    check_interval,
)
from jaxglider.signals import GliderState, Measurement

STATES = tuple(field.name for field in dataclasses.fields(GliderState))
"""Names of the states, each of which can be measured."""


class Sensor(Container):
    """The error of one sensor.

    Attributes:
        bias: b, constant over a run [unit of the state].
        noise: σ ≥ 0, standard deviation of the white noise [unit of the state].

    Raises:
        ValueError: the noise is negative, or a number is not finite.
    """

    bias: Scalar = eqx.field(converter=as_float, default=0.0)
    noise: Scalar = eqx.field(converter=as_float, default=0.0)

    def __check_init__(self) -> None:
        check_interval("Sensor", "noise", self.noise, 0.0, closed_low=True)


def check_sensors(sensors: Mapping[str, Sensor] | None) -> None:
    """Refuse sensors of what is no state.

    Raises:
        ValueError: names the sensor and the states.
    """
    for name in sensors or ():
        if name not in STATES:
            raise ValueError(
                f"sensors must be named after states; received {name!r}; "
                f"choose from {', '.join(STATES)}."
            )


def realise_errors(
    sensors: Mapping[str, Sensor], key: jax.Array, times: Series
) -> dict[str, Series]:
    """The error of each sensor at each of the times; every sensor has its own key.

    Args:
        sensors: sensors by the names of their states.
        key: random key.
        times: times of measurement [s].
    """
    return {
        name: sensor.bias
        + sensor.noise
        * jr.normal(jr.fold_in(key, STATES.index(name)), times.shape, times.dtype)
        for name, sensor in sensors.items()
    }


def with_errors(state: GliderState, errors: Mapping[str, Scalar] | None) -> GliderState:
    """The state as the sensors give it; itself without any errors.

    Args:
        state: true state.
        errors: errors by the names of the states, in their units, or None.
    """
    return dataclasses.replace(
        state, **{name: getattr(state, name) + e for name, e in (errors or {}).items()}
    )


def measured(truth: Measurement, errors: Mapping[str, Scalar] | None) -> Measurement:
    """The measurement of a glider whose sensors have errors.

    Args:
        truth: measurement of perfect sensors.
        errors: errors by the names of the states, in their units, or None.
    """
    if errors is None:
        return truth
    state = with_errors(truth.state, errors)
    return dataclasses.replace(truth, state=state, attitude=state.attitude())
