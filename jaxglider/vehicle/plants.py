"""Names of the plants."""

from collections.abc import Callable

from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant, printed_plant, rigid_body_plant

PLANTS: dict[str, Callable[[VehicleData], AbstractPlant]] = {
    "printed": lambda vehicle: printed_plant(vehicle.parameters),
    "rigid-body": lambda vehicle: rigid_body_plant(vehicle.parameters),
    "seawing": full_plant,
}
"""The paper's glider, the same with a consistent moving mass, and the published one."""
