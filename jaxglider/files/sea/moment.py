"""Place and time that a mission starts at, where its files of the sea are read."""

import dataclasses
import datetime
from collections.abc import Mapping
from typing import Any

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.places import Plane


@dataclasses.dataclass(frozen=True)
class Moment:
    """Place and time that a mission starts at.

    Attributes:
        plane: plane around the start, or None where it is nowhere on Earth.
        start: time of the start, or None where it has no date.
        reach: distance from the start [m] that the mission may come to.
    """

    plane: Plane | None
    start: datetime.datetime | None
    reach: float = 30e3


def started(data: Mapping[str, Any]) -> datetime.datetime | None:
    """The date of the start in UTC, `clock.start`; None where a mission has none.

    Args:
        data: tables of the mission.

    Raises:
        ConfigError: it is no date.
    """
    clock = data.get("clock")
    value = clock.get("start") if isinstance(clock, dict) else None
    if value is None:
        return None
    if not isinstance(value, datetime.datetime):
        raise ConfigError(
            f"clock.start must be a date and time such as 2024-05-01T06:00:00Z, "
            f"without quotes; received {value!r}."
        )
    if value.tzinfo is None:
        return value.replace(tzinfo=datetime.UTC)
    return value.astimezone(datetime.UTC)
