"""Orders of a plan, carried out whatever the law wants.

A law that does not know of orders obeys them too: it is told the ballast, and what it
wants is overruled. On board the same two functions stand around it.
"""

import dataclasses

import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.signals import Command, Measurement, Reference


def informed(measurement: Measurement, reference: Reference) -> Measurement:
    """The measurement with the ballast that the plan has ordered, if it has.

    Args:
        measurement: everything that is known of the glider.
        reference: wanted outputs, with orders or without.
    """
    if reference.orders is None:
        return measurement
    return dataclasses.replace(
        measurement, buoyancy_mass=reference.orders.buoyancy_mass
    )


def obeyed(
    wanted: Command[Scalar], reference: Reference, held: Command[Scalar]
) -> Command[Scalar]:
    """The command with what the plan orders in place of what the law wants.

    Args:
        wanted: command of the law [kg, m, rad].
        reference: wanted outputs, with orders or without.
        held: command held by the actuators [kg, m, rad].
    """
    orders = reference.orders
    if orders is None:
        return wanted
    angle = wanted.mass_angle if orders.steering is None else orders.steering
    if orders.steering_limit is not None:
        angle = jnp.clip(angle, -orders.steering_limit, orders.steering_limit)
    return Command(
        orders.buoyancy_mass,
        jnp.where(orders.mass_held, held.mass_position, wanted.mass_position),
        angle,
    )
