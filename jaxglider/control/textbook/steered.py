"""Common part of the textbook laws that leave the turn to a steering."""

import equinox as eqx

from jaxglider.control.controller import AbstractController, default_damping
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.steering import INVERSION, AbstractSteering
from jaxglider.core.containers import Scalar
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import Command
from jaxglider.vehicle.design_model import DesignModel


class AbstractSteeredLaw(AbstractController):
    """A law that asks a steering for its turns; its own fields are gains with defaults.

    Attributes:
        model: design model, the designer's belief about the glider.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        damping: damping of the allocation, one number per actuator.
        steering: way to steer; the paper's inversion by default.
    """

    model: DesignModel
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    damping: Command[Scalar] = eqx.field(
        default_factory=default_damping, metadata={"set": POSITIVE}
    )
    steering: AbstractSteering = INVERSION

    @classmethod
    def initial(
        cls,
        model: DesignModel,
        funnel: Funnel | None = None,
        steering: AbstractSteering = INVERSION,
    ) -> "AbstractSteeredLaw":
        """The law with the gains it begins with, by hand for a SeaWing.

        Args:
            model: design model.
            funnel: funnel that errors are judged by.
            steering: way to steer.
        """
        return cls(model, funnel, steering=steering)
