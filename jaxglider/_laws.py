"""Distributions as TOML tables.

`{law = "uniform", half_width = 0.2}`, or low and high; `{law = "normal",
standard_deviation = 0.1, truncation = 3.0}`; `{law = "log-normal", standard_deviation =
0.3}`, of the logarithm. Where a law is of a factor on the nominal value it is centred
on 1, where it is of an offset on 0; elsewhere it must say where it lies.
"""

from typing import Any

from jaxglider._toml import ConfigError, Table, choice, number
from jaxglider.distributions import (
    AbstractDistribution,
    LogNormal,
    TruncatedNormal,
    Uniform,
)


def read_law(
    given: Any, where: str, centre: float | None = None, unit: float = 1.0
) -> AbstractDistribution:
    """A distribution from its table; a plain number is the one value it can take.

    Args:
        given: the table or number.
        where: its path in the file, for messages.
        centre: of a law that does not say where it lies; None where it must.
        unit: what its numbers are multiplied by.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    if not isinstance(given, dict):
        value = unit * number(given, where)
        return Uniform(value, value)
    table = Table(given, where)
    make = choice(table.get("law"), _LAWS, table.where("law"))
    try:
        made: AbstractDistribution = make(table, centre, unit)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error
    table.close()
    return made


def _uniform(table: Table, centre: float | None, unit: float) -> Uniform:
    if table.get("half_width", None) is None:
        return Uniform(unit * table.number("low"), unit * table.number("high"))
    mean, width = _middle(table, "mean", centre), table.number("half_width")
    if width < 0.0:
        raise ConfigError(
            f"{table.where('half_width')} must be zero or positive; received {width:g}."
        )
    return Uniform(unit * (mean - width), unit * (mean + width))


def _normal(table: Table, centre: float | None, unit: float) -> TruncatedNormal:
    mean = _middle(table, "mean", centre)
    deviation = table.number("standard_deviation")
    cut = table.number("truncation", 3.0)
    return TruncatedNormal(unit * mean, unit * deviation, cut)


def _log_normal(table: Table, centre: float | None, unit: float) -> LogNormal:
    median = _middle(table, "median", centre)
    deviation = table.number("standard_deviation")
    return LogNormal(unit * median, deviation, table.number("truncation", 3.0))


def _middle(table: Table, key: str, centre: float | None) -> float:
    if centre is None:
        return table.number(key)
    return table.number(key, centre)


_LAWS = {"uniform": _uniform, "normal": _normal, "log-normal": _log_normal}
