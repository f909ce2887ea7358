"""Name-value lists of an autopilot, of a Slocum, a Seaglider or a SeaExplorer.

One name and one number a line, in the form that the vendors' files have them:
`sensor: u_hd_fin_ap_gain(1/rad) 1.5`, `$HEAD_ERRBAND,10`, `heading.pid.kp=0.2`, or
plainly `name value`. What stands behind `#`, `%` or `/` is a remark. Names that a law
of the catalogue has a number for are turned into it and back; all others are handed on
as unknown. Only names and units are the vendors'; what they mean is in the laws' texts.
"""

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError, reason

_DEG = math.pi / 180.0
_INCH = 0.0254
_KG_PER_CC = 1.0275e-3
"""Sea water of 1.0275 g/cm³, for shifts per volume of ballast."""
_LINE = re.compile(
    r"^(?:sensor:\s*)?\$?(?P<name>[A-Za-z_][\w.]*)(?:\([^)]*\))?\s*[\s,=]\s*(?P<value>\S+)"
)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A number of a law under the vendor's name.

    Attributes:
        key: key of the number in a gains file.
        factor: number of the gains file over the vendor's.
        unit: unit of the vendor's, for tables.
    """

    key: str
    factor: float = 1.0
    unit: str = ""


SLOCUM = {
    "u_hd_fin_ap_gain": Setting("heading_gain_1_rad", 1.0, "1/rad"),
    "u_hd_fin_ap_igain": Setting("heading_integral_1_rad_s", 1.0, "1/rad-s"),
    "u_hd_fin_ap_dgain": Setting("heading_rate_s_rad", 1.0, "s/rad"),
    "u_heading_deadband": Setting("heading_band_rad", 1.0, "rad"),
    "u_heading_rate_deadband": Setting("heading_rate_band_rad_s", 1.0, "rad/s"),
    "u_hd_fin_ap_hardover_holdoff": Setting("integral_wait_s", 1.0, "s"),
    "u_hd_fin_ap_run_time": Setting("cycle_s", 1.0, "s"),
    "u_pitch_ap_gain": Setting("pitch_gain_1_rad", 1.0, "1/rad"),
    "u_pitch_ap_dgain": Setting("pitch_rate_s_rad", 1.0, "s/rad"),
    "u_pitch_ap_deadband": Setting("pitch_band_rad", 1.0, "rad"),
    "u_pitch_max_delta_battpos": Setting("largest_step_m", _INCH, "in"),
    "u_max_pitch_ap_period": Setting("longest_wait_s", 1.0, "s"),
}
"""Sensors of a Slocum that `slocum` has numbers for."""

SEAGLIDER = {
    "PITCH_GAIN": Setting("pitch_map_rad_m", _DEG / 0.01, "deg/cm"),
    "PITCH_VBD_SHIFT": Setting("ballast_shift_m_kg", 0.01 / _KG_PER_CC, "cm/cm3"),
    "PITCH_ADJ_GAIN": Setting("adjust_gain_m_rad", 0.01 / _DEG, "cm/deg"),
    "PITCH_ADJ_DBAND": Setting("adjust_band_rad", _DEG, "deg"),
    "PITCH_DBAND": Setting("least_move_m", 0.01, "cm"),
    "ROLL_DEG": Setting("roll_angle_rad", _DEG, "deg"),
    "HEAD_ERRBAND": Setting("heading_band_rad", _DEG, "deg"),
    "T_TURN": Setting("longest_turn_s", 1.0, "s"),
    "ROLL_ADJ_GAIN": Setting("centre_gain_s", 1.0, "deg/(deg/s)"),
    "ROLL_ADJ_DBAND": Setting("centre_band_rad_s", _DEG, "deg/s"),
    "DBDW": Setting("rate_gain_kg_s_m", 1e-3, "g s/m"),
    "W_ADJ_DBAND": Setting("rate_band_m_s", 0.01, "cm/s"),
}
"""Parameters of a Seaglider that `seaglider` has numbers for."""

SEAEXPLORER = {
    "period1": Setting("period_s", 1.0, "s"),
    "heading.deadzone": Setting("dead_zone_rad", _DEG, "deg"),
    "heading.pid.kp": Setting("heading_gain", 1.0, "deg/deg"),
    "heading.pid.ki": Setting("heading_integral_1_s", 1.0, "1/s"),
    "heading.pid.kd": Setting("heading_rate_s", 1.0, "s"),
    "heading.pid.il": Setting("integral_limit_rad", _DEG, "deg"),
    "heading.pid.el": Setting("largest_error_rad", _DEG, "deg"),
    "heading.pid.hi": Setting("largest_angle_rad", _DEG, "deg"),
    "heading.pid.lo": Setting("largest_angle_rad", -_DEG, "deg"),
}
# Names as in the file that comes with pyglider's example data; units are assumed.
"""Keys of a SeaExplorer's `sea.cfg` that `seaexplorer` has numbers for."""

KNOWN: dict[str, dict[str, Setting]] = {
    "slocum": SLOCUM,
    "seaglider": SEAGLIDER,
    "seaexplorer": SEAEXPLORER,
}
"""Names by the law that they are for."""
_FORMS = {
    "slocum": "{name} {value:.6g}  # {unit}",
    "seaglider": "${name},{value:.6g}",
    "seaexplorer": "{name}={value:.6g}",
}
"""A line of the list that each vendor's glider reads."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """Numbers of a list, and the names in it that are not known.

    Attributes:
        law: name of the law that it is for.
        values: numbers by the vendor's names, in the vendor's units.
        unknown: names that the law has no number for, in their order.
    """

    law: str
    values: dict[str, float]
    unknown: tuple[str, ...] = ()

    def gains(self) -> dict[str, Any]:
        """Tables of a gains file; what is not listed is as the law begins with."""
        known = KNOWN[self.law]
        numbers = {known[n].key: x * known[n].factor for n, x in self.values.items()}
        controller = {"type": self.law, **numbers}
        return {"format": 1, "controller": controller, "observer": {"type": "none"}}

    def text(self) -> str:
        """The list, one name and one number a line, as the vendor's files have it."""
        known, form = KNOWN[self.law], _FORMS[self.law]
        lines = [
            form.format(name=n, value=x, unit=known[n].unit)
            for n, x in self.values.items()
        ]
        return "\n".join(lines) + "\n"


def read_settings(path: str | Path, law: str) -> Settings:
    """Read a list.

    Args:
        path: path of the file.
        law: name of the law that it is for, a key of `KNOWN`.

    Raises:
        ConfigError: the file cannot be read, a value is no number, no name of the law
            is in it, or two names for one number of the law disagree.
    """
    known, values, unknown = KNOWN[law], {}, []
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {reason(error)}.") from error
    for number, line in enumerate(text.splitlines(), 1):
        found = _LINE.match(re.split(r"[#%/]", _without_unit(line))[0].strip())
        if found is None:
            continue
        name = found["name"]
        if name not in known:
            unknown.append(name)
            continue
        values[name] = _number(found["value"], f"{path}: line {number}: {name}")
    if not values:
        raise ConfigError(
            f"{path} must have a name that {law} has a number for, one of "
            f"{', '.join(known)}; received {', '.join(unknown) or 'none at all'}."
        )
    _refuse_contradictions(values, known, path)
    return Settings(law, values, tuple(dict.fromkeys(unknown)))


def _refuse_contradictions(
    values: Mapping[str, float], known: Mapping[str, Setting], path: str | Path
) -> None:
    """Two names that stand for one number of the law have to agree, as hi and lo."""
    first: dict[str, str] = {}
    for name, value in values.items():
        setting = known[name]
        other = first.setdefault(setting.key, name)
        wanted = values[other] * known[other].factor / setting.factor
        if not math.isclose(value, wanted, rel_tol=1e-9):
            raise ConfigError(
                f"{path}: {name} must be {wanted:.6g}, for {other} is "
                f"{values[other]:.6g} and the law has one number for both; received "
                f"{value:.6g}."
            )


def settings_of(tables: Mapping[str, Any], source: str) -> Settings:
    """The list that a gains file stands for.

    Args:
        tables: tables of the gains file.
        source: name of the file, for messages.

    Raises:
        ConfigError: it is for a law that no vendor has names for.
    """
    controller = tables["controller"]
    law = controller["type"]
    if law not in KNOWN:
        raise ConfigError(
            f"{source}: controller.type must be one of {', '.join(KNOWN)}; "
            f"received {law!r}."
        )
    values = {
        name: controller[setting.key] / setting.factor
        for name, setting in KNOWN[law].items()
        if setting.key in controller
    }
    return Settings(law, values)


def _without_unit(line: str) -> str:
    """A line without the unit in brackets, which may hold the sign of a remark."""
    return re.sub(r"\([^)]*\)", " ", line, count=1)


def _number(text: str, where: str) -> float:
    try:
        value = float(text.rstrip(",;"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(f"{where} must be a finite number; received {text!r}.")
    return value
