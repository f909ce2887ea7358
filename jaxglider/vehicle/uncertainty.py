"""Which parameters are uncertain, how far, and how a sample of them is drawn."""

import dataclasses

import equinox as eqx
import jax
import jax.random as jr

from jaxglider._types import Container, Scalar, as_float, check_interval
from jaxglider.vehicle.parameters import UNCERTAIN, GliderParameters


class UniformUncertainty(Container):
    """Each named parameter is its nominal value times 1 + h ξ, ξ uniform in [−1, 1).

    Attributes:
        half_width: h, relative, in [0, 1).
        names: the uncertain fields of `GliderParameters`.

    Raises:
        ValueError: `half_width` outside [0, 1), or an unknown name.
    """

    half_width: Scalar = eqx.field(converter=as_float)
    names: tuple[str, ...] = eqx.field(static=True, default=UNCERTAIN)

    def __check_init__(self) -> None:
        check_interval(
            "UniformUncertainty",
            "half_width",
            self.half_width,
            0.0,
            1.0,
            closed_low=True,
        )
        known = _field_numbers()
        for name in self.names:
            if name not in known:
                raise ValueError(
                    f"UniformUncertainty.names must be fields of GliderParameters; "
                    f"received {name!r}; choose from {', '.join(known)}."
                )

    def sample(self, key: jax.Array, nominal: GliderParameters) -> GliderParameters:
        """One sample. Each parameter has its own key: adding one moves no other."""
        numbers = _field_numbers()

        def draw(name: str) -> Scalar:
            value = getattr(nominal, name)
            own = jr.fold_in(key, numbers[name])
            return value * (
                1.0 + self.half_width * jr.uniform(own, (), value.dtype, -1, 1)
            )

        return dataclasses.replace(nominal, **{name: draw(name) for name in self.names})


def _field_numbers() -> dict[str, int]:
    return {f.name: i for i, f in enumerate(dataclasses.fields(GliderParameters))}
