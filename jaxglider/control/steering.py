"""From the heading acceleration that a law asks for to a command: two ways to steer.

Every law asks for output accelerations; its `steering` turns them into a command.
`Inversion` is the paper's: U = g⁻¹ (demand − f − h d̂) in all three channels. It takes
the yaw that the mass angle makes at once for the turn. On a glider that rolls towards
its mass that works in a dive; in a climb the turn in the end has the other sign, and an
inverse of the first is unstable (`docs/heading.md`).

`BankSteering` asks the heading for a bank, and the bank for a mass angle.
"""

import dataclasses
import math
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control.turning import turn_model
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.numerics import barrier, saturate, sincos
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE, Interval
from jaxglider.signals import Channels, Command, Measurement, Reference, map_fields
from jaxglider.vehicle.design_model import DesignModel, InputGain


class Asked(eqx.Module):
    """Wishes of a law in the previous tick.

    Attributes:
        command: command [kg, m, rad].
        turn: wanted acceleration of the heading [rad/s²].
    """

    command: Command[Scalar]
    turn: Scalar


class AbstractSteering(Container):
    """A way to carry out the output accelerations that a law asks for."""

    def error_rate(
        self,
        model: DesignModel,
        measurement: Measurement,
        reference: Reference,
        rate: Channels[Scalar],
    ) -> Channels[Scalar]:
        """e' [m/s, rad/s] as a law should see it; as it is where nothing else is said.

        Args:
            model: design model.
            measurement: everything that may be known of the glider.
            reference: wanted outputs with their rates.
            rate: e' [m/s, rad/s].
        """
        return rate

    @abstractmethod
    def command(
        self,
        model: DesignModel,
        measurement: Measurement,
        demand: Channels[Scalar],
        damping: Command[Scalar],
    ) -> Command[Scalar]:
        """The command for wanted output accelerations.

        Args:
            model: design model.
            measurement: measurement, which carries d̂.
            demand: wanted output acceleration η'' [m/s², rad/s²].
            damping: terms added to the diagonal of gᵀg, one positive number each.
        """

    @abstractmethod
    def shortfall(
        self, model: DesignModel, measurement: Measurement, asked: Asked
    ) -> Channels[Scalar]:
        """ν_h: what the glider does beyond what was asked for [m/s², rad/s²].

        Args:
            model: design model.
            measurement: measurement, with the command that the actuators hold.
            asked: wishes of the law.
        """


class Inversion(AbstractSteering):
    """The paper's: g inverted by damped least squares."""

    @jax.named_scope("allocation")
    def command(
        self,
        model: DesignModel,
        measurement: Measurement,
        demand: Channels[Scalar],
        damping: Command[Scalar],
    ) -> Command[Scalar]:
        """U = g⁻¹(demand − f − h d̂); without the depth where ballast is ordered."""
        push, gain = _push_and_gain(model, measurement, demand)
        if measurement.buoyancy_mass is not None:
            return gain.solve_at(measurement.buoyancy_mass, push, damping)
        return gain.solve(push, damping)

    def shortfall(
        self, model: DesignModel, measurement: Measurement, asked: Asked
    ) -> Channels[Scalar]:
        """g (U_applied − U_asked)."""
        kept_back = map_fields(jnp.subtract, measurement.applied, asked.command)
        return model.input_gain(measurement).response(kept_back)


INVERSION = Inversion()


def _push_and_gain(
    model: DesignModel, measurement: Measurement, demand: Channels[Scalar]
) -> tuple[Channels[Scalar], InputGain]:
    """The push that is left to the command, demand − f − h d̂, and g."""
    push = map_fields(lambda d, f: d - f, demand, model.drift(measurement))
    left: tuple[Channels[Scalar], InputGain] = barrier(
        (push, model.input_gain(measurement))
    )
    return left


def steering_angle(
    steering: AbstractSteering,
    model: DesignModel,
    measurement: Measurement,
    turn: Scalar,
    ballast: Scalar,
    damping: Command[Scalar],
) -> Scalar:
    """Mass or fin angle [rad] for a turn, of a law that sets the other two itself.

    Args:
        steering: way to steer.
        model: design model.
        measurement: measurement, which carries d̂.
        turn: wanted acceleration of the heading [rad/s²].
        ballast: m_b that the law sets [kg].
        damping: terms added to the diagonal of gᵀg, one positive number each.
    """
    zero = jnp.zeros_like(turn)
    known = dataclasses.replace(measurement, buoyancy_mass=ballast)
    demand = Channels(zero, zero, turn)
    angle: Scalar = steering.command(model, known, demand, damping).mass_angle
    return angle


class BankSteering(AbstractSteering):
    """Heading asks for a bank, the bank for a mass angle; each with gains of its own.

    With a the acceleration that the law wants, and N and T of the `TurnModel`, the bank
    is the one that makes the turn grow as fast as wanted once the slip has settled,

    φ_w = T a N/(N² + ε²),   φ_c = clip(φ_w, ±φ_max).

    ε keeps it small where a bank does little, as in slow and in steep glides. The mass
    angle holds that bank against the hull's weight, and brings the glider there:

    γ = φ_c + (m_h z_h/m_p R_p) sin φ_c + k (φ_c − φ) − b p.

    The slip's rolling moment is left to the feedback: a glider in a current does not
    know its slip.

    Buoyancy and position of the mass are then solved for depth and pitch with this γ,
    as the paper does for all three. The law sees the `TurnModel`'s Ω for ψ'.

    Attributes:
        smallest_response: ε [1/s³], the N below which less bank is asked for.
        bank_gain: k ≥ 0, mass angle per error of the bank.
        roll_damping: b ≥ 0, mass angle per roll rate [s].
        largest_bank: φ_max in (0, π/2) [rad].

    Raises:
        ValueError: a gain is outside its set.
    """

    smallest_response: Scalar = eqx.field(
        converter=as_float, default=1e-3, metadata={"unit": "per_s3", "set": POSITIVE}
    )
    bank_gain: Scalar = eqx.field(
        converter=as_float, default=0.3, metadata={"set": NOT_NEGATIVE}
    )
    roll_damping: Scalar = eqx.field(
        converter=as_float, default=4.0, metadata={"unit": "s", "set": NOT_NEGATIVE}
    )
    # 40 deg: the roll overshoots it by some degrees.
    largest_bank: Scalar = eqx.field(
        converter=as_float,
        default=0.7,
        metadata={"unit": "rad", "set": Interval(0.0, math.pi / 2), "tuned": False},
    )

    def error_rate(
        self,
        model: DesignModel,
        measurement: Measurement,
        reference: Reference,
        rate: Channels[Scalar],
    ) -> Channels[Scalar]:
        """e' with Ω for ψ': without the swing of a rolling glider."""
        turning = turn_model(model, measurement).rate
        return Channels(rate.depth, rate.pitch, turning - reference.rate.heading)

    @jax.named_scope("allocation")
    def command(
        self,
        model: DesignModel,
        measurement: Measurement,
        demand: Channels[Scalar],
        damping: Command[Scalar],
    ) -> Command[Scalar]:
        """γ for the heading; m_b and r_p1 for depth and pitch with that γ.

        Where ballast is ordered, r_p1 is solved for the pitch alone.
        """
        turn = turn_model(model, measurement)
        least = self.smallest_response * self.smallest_response
        share = turn.response / (turn.response * turn.response + least)
        wanted = turn.damping * demand.heading * share
        bank = saturate(wanted, self.largest_bank)
        angle = self._mass_angle(model, measurement, bank)
        push, gain = _push_and_gain(model, measurement, demand)
        if measurement.buoyancy_mass is not None:
            return gain.position_at(measurement.buoyancy_mass, push, damping, angle)
        return gain.solve_with_angle(push, damping, angle)

    def shortfall(
        self, model: DesignModel, measurement: Measurement, asked: Asked
    ) -> Channels[Scalar]:
        """g (U_applied − U_asked) for depth and pitch, N φ/T − a for the heading.

        So what ε and the limit of the bank take from a counts as not carried out, and a
        law that hedges integrates less where a bank does little: in a climb, its
        integral would else swing. γ is left out of the first: it is known when the
        others are solved for.
        """
        kept_back = map_fields(jnp.subtract, measurement.applied, asked.command)
        zero = jnp.zeros_like(asked.turn)
        moved = Command(kept_back.buoyancy_mass, kept_back.mass_position, zero)
        reached = model.input_gain(measurement).response(moved)
        turn = turn_model(model, measurement)
        # At rest both are zero.
        share = turn.response / jnp.where(turn.damping > 0.0, turn.damping, 1.0)
        delivered = share * wrap(measurement.state.roll)
        return Channels(reached.depth, reached.pitch, delivered - asked.turn)

    def _mass_angle(
        self, model: DesignModel, measurement: Measurement, bank: Scalar
    ) -> Scalar:
        """γ [rad] that brings the glider to a bank [rad] and holds it there."""
        c, s = model.parameters, measurement.state
        moving = c.moving_mass * c.mass_offset
        return (
            bank
            + model.actuation.hull_below_axis(c) / moving * sincos(bank)[0]
            + self.bank_gain * (bank - wrap(s.roll))
            - self.roll_damping * s.roll_rate
        )
