"""Tables of a mission file on the start and the water that may carry the glider."""

import dataclasses
import math

import jax.numpy as jnp

from jaxglider.core import rotations
from jaxglider.core.toml import ConfigError, TomlTable
from jaxglider.environment.tables import CurrentTable, DensityProfile
from jaxglider.environment.water import Current, Stratification, Water
from jaxglider.files.flight.yo_tables import built
from jaxglider.signals import GliderState
from jaxglider.simulation.origin import Origin
from jaxglider.vehicle.parameters import VehicleData

STATE_UNITS = {
    **dict.fromkeys(("north", "east", "depth"), ("m", 1.0)),
    **dict.fromkeys(("roll", "pitch", "heading"), ("deg", math.pi / 180)),
    **dict.fromkeys(("surge", "sway", "heave"), ("m_s", 1.0)),
    **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), ("deg_s", math.pi / 180)),
}
"""Unit at the end of the key of each state, and its factor to SI."""
_LINEAR = ("surge", "sway", "heave")


def read_origin(start: TomlTable) -> Origin:
    """The place that positions count from: the start, taken off before they are cast.

    Args:
        start: the table of the initial state, which is read again later.
    """
    north, east = start.number("north_m", 0.0), start.number("east_m", 0.0)
    degrees = [start.get(key, None) for key in ("latitude_deg", "longitude_deg")]
    if None in degrees:
        return Origin.at_start(north, east)
    return Origin(place=(float(degrees[0]), float(degrees[1])))


def read_initial_state(
    table: TomlTable, origin: Origin, water: Water | None = None
) -> GliderState:
    """State at the start; angles in degrees in the file.

    Velocities are over ground, or through the water where the key says so.

    Args:
        table: table to read.
        origin: place that positions count from.
        water: water that may carry the glider.
    """
    for key in ("latitude_deg", "longitude_deg"):
        table.get(key, None)  # of the origin
    drifting = [f"{name}_through_water_m_s" for name in _LINEAR]
    relative = {key: table.get(key, None) for key in drifting}
    values = {
        name: scale * table.number(f"{name}_{unit}", 0.0)
        for name, (unit, scale) in STATE_UNITS.items()
    }
    given = [key for key, value in relative.items() if value is not None]
    for name, key in zip(_LINEAR, drifting, strict=True):
        if given and table.get(f"{name}_m_s", None) is not None:
            raise ConfigError(
                f"{table.where(name)}_m_s is over ground and does not go with "
                f"{table.where(given[0])}: give all three one way or the other."
            )
        if given:
            values[name] = table.number(key, 0.0)
    values["north"] -= origin.north
    values["east"] -= origin.east
    table.close()
    if abs(values["pitch"]) >= math.pi / 2:
        raise ConfigError(
            "initial_state.pitch_deg must be in (-90, 90); "
            f"received {table.number('pitch_deg'):g}."
        )
    state = GliderState(**values)
    return _carried(state, water) if given else state


def _carried(state: GliderState, water: Water | None) -> GliderState:
    """The state over ground of a glider whose velocity is through the water."""
    if water is None or water.current is None:
        return state
    zero = jnp.zeros_like(state.depth)
    north, east = water.current.velocity(state.depth, zero)
    drift = rotations.ned_to_body(state.attitude(), north, east, zero)
    moved = {
        name: getattr(state, name) + part
        for name, part in zip(_LINEAR, drift, strict=True)
    }
    return dataclasses.replace(state, **moved)


def read_water(table: TomlTable, vehicle: VehicleData) -> Water | None:
    """Currents and density; nothing if neither is asked for."""
    current = stratification = None
    if table.get("current", None) is not None:
        own = table.table("current")
        values = [own.number(key, 0.0) for key in CURRENT_KEYS]
        period = own.number("tide_period_s", 44712.0)
        phase = math.radians(own.number("tide_phase_deg", 0.0))
        model = _current_table(own)
        own.close()
        current = built(Current, "water.current", *values, period, phase, model)
    if table.get("stratification", None) is not None:
        own = table.table("stratification")
        if vehicle.body is None:
            mass = own.number("displaced_mass_kg")
        else:
            displaced = float(vehicle.body.displaced_mass(vehicle.parameters))
            mass = own.number("displaced_mass_kg", displaced)
        values = [own.number(key, 0.0) for key in STRATIFICATION_KEYS]
        profile = _profile(own)
        own.close()
        stratification = built(
            Stratification, "water.stratification", mass, *values, profile
        )
    table.close()
    if current is None and stratification is None:
        return None
    return Water(current, stratification)


def _current_table(table: TomlTable) -> CurrentTable | None:
    """The velocities of an ocean model, if the mission has some."""
    if table.get("table", None) is None:
        return None
    own = table.table("table")
    where = own.where("")[:-1]
    axes = [own.numbers(key) for key in ("time_s", "depth_m")]
    grids = [own.rows(key) for key in ("north_m_s", "east_m_s")]
    own.close()
    model: CurrentTable = built(CurrentTable, where, *axes, *grids)
    return model


def _profile(table: TomlTable) -> DensityProfile | None:
    """The density over depth, if the mission has it."""
    if table.get("profile", None) is None:
        return None
    own = table.table("profile")
    where = own.where("")[:-1]
    values = [own.numbers(key) for key in ("depth_m", "density_kg_m3")]
    own.close()
    profile: DensityProfile = built(DensityProfile, where, *values)
    return profile


CURRENT_KEYS = (
    "north_m_s",
    "east_m_s",
    "shear_north_1_s",
    "shear_east_1_s",
    "tide_north_m_s",
    "tide_east_m_s",
)
STRATIFICATION_KEYS = (
    "density_gradient_1_m",
    "hull_compressibility_1_m",
    "neutral_depth_m",
)
