"""Raw samples of the sensors, as a host hands them to the autopilot at each tick.

A host hands on what its sensors have given last; a sample is new where its time is
another one than that of the sample before. Nothing here needs to be sound.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar
from jaxglider.navigation.sensing.readings import Sensed
from jaxglider.onboard.guard import SOUND, is_within
from jaxglider.signals import Command

SAME = 1e-9
"""Difference of two times from which they are two [s]; some machines round less off."""
OLDEST = 60.0
"""Age beyond which the time of a sample is not believed: it is taken for new [s]."""

NOTHING = 1e-30
"""Modulus below which a number counts as zero; see `with_no_traces`."""


class Sample(eqx.Module):
    """The newest sample of one sensor.

    Attributes:
        value: number that the sensor gave [m or rad]; NaN for none.
        time: reading of the clock when it was taken [s].
        valid: flag, the sensor takes it to be good.
    """

    value: Scalar
    time: Scalar
    valid: Flag


class FixSample(eqx.Module):
    """The newest position by satellite.

    Attributes:
        north: position north [m].
        east: position east [m].
        time: reading of the clock when it was taken [s].
        valid: flag, the receiver takes it to be good.
    """

    north: Scalar
    east: Scalar
    time: Scalar
    valid: Flag


class Samples(eqx.Module):
    """All that a host knows at the start of a tick.

    Attributes:
        sensed: samples of depth, roll, pitch and heading.
        position: measured positions of the actuators [kg, m, rad]; NaN where a host
            does not know them.
        echo: echo of the altimeter [m], or None without one.
        fix: position by satellite, or None without a receiver.
    """

    sensed: Sensed[Sample]
    position: Command[Scalar]
    echo: Sample | None = None
    fix: FixSample | None = None


def is_fresh(sample: Sample, stamp: Scalar, limit: Scalar) -> Flag:
    """Whether a sample is new and good.

    Args:
        sample: newest sample.
        stamp: time of the one before [s].
        limit: largest modulus believed [m or rad].
    """
    good = sample.valid & is_within(sample.value, limit)
    return good & is_new(sample.time, stamp)


def is_new(time: Scalar, stamp: Scalar) -> Flag:
    """Whether the time of a sample is another one than that of the sample before.

    Args:
        time: time of the newest sample [s].
        stamp: time of the one before [s].
    """
    return jnp.isfinite(time) & (jnp.abs(time - stamp) > SAME)


def newest(sample: Sample, stamp: Scalar) -> Scalar:
    """Time of the newest sample that has one [s], good or bad.

    Args:
        sample: newest sample.
        stamp: time of the one before [s].
    """
    return jnp.where(jnp.isfinite(sample.time), sample.time, stamp)


def age_of(sample: Sample, time: Scalar) -> Scalar:
    """Age of a sample [s]; zero where the clock or the sample's time is not sound.

    Args:
        sample: newest sample.
        time: reading of the clock [s].
    """
    age = time - sample.time
    return jnp.where((age >= 0.0) & (age <= OLDEST), age, 0.0)


def with_no_traces(value: Scalar) -> Scalar:
    """A number, or zero where it is next to nothing.

    XLA computes with zero where a number is too small for its format, a processor on
    board may not. A filter that begins at a depth of zero has another slope, out of the
    water on one side, than one that begins 1e-320 m deeper.

    Args:
        value: any number, or none.
    """
    return jnp.where(jnp.abs(value) < NOTHING, 0.0, value)


def measured_or(position: Scalar, modelled: Scalar, limit: Scalar) -> Scalar:
    """A measured position of an actuator, or the modelled one where there is none.

    Args:
        position: measured position [kg, m or rad].
        modelled: modelled position.
        limit: limit of the actuator.
    """
    known = jnp.abs(position) <= SOUND
    within = jnp.clip(with_no_traces(position), -limit, limit)
    return jnp.where(known, within, modelled)
