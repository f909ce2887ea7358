"""Reading TOML so that a user can act on every complaint.

Each message names the key by its full path, the rule, and what was received.
"""

import difflib
import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_REQUIRED = object()
_GEOGRAPHIC = re.compile(r"(start_)?(lat|lon|lng)", re.IGNORECASE)


class ConfigError(ValueError):
    """A file says something that cannot be used; the message names the key."""


def number(value: Any, where: str) -> float:
    """A TOML number as a float.

    Args:
        value: value from the file.
        where: path of its key, for the message.

    Raises:
        ConfigError: it is no number, or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{where} must be a number; received {value!r}.")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise ConfigError(f"{where} must be finite; received {value!r}.")
    return result


def whole_number(value: Any, where: str) -> int:
    """A TOML integer that fits 32 bits.

    Args:
        value: value from the file.
        where: path of its key, for the message.

    Raises:
        ConfigError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        raise ConfigError(f"{where} must be a whole number; received {value!r}.")
    if abs(value) > 2**32:
        raise ConfigError(f"{where} must be a whole number of at most 2^32.")
    return value


def choice(name: Any, allowed: dict[str, Any], where: str) -> Any:
    """The value that a name stands for.

    Args:
        name: name from the file.
        allowed: values by their names.
        where: path of its key, for the message.

    Raises:
        ConfigError: the name is not among those allowed.
    """
    if not isinstance(name, str) or name not in allowed:
        raise ConfigError(
            f"{where} must be one of {', '.join(allowed)}; received {name!r}."
        )
    return allowed[name]


def refuse_unknown(rest: Any, allowed: list[str], path: str) -> None:
    """Refuse keys that nobody has read.

    Args:
        rest: keys left over.
        allowed: keys there are.
        path: path of their table, for the message.

    Raises:
        ConfigError: names the first such key, and the nearest one allowed.
    """
    for key in rest:
        near = difflib.get_close_matches(key, allowed, 1)
        hint = (
            f"did you mean {near[0]}?" if near else f"choose from {', '.join(allowed)}."
        )
        if _GEOGRAPHIC.match(key) and any(name.endswith("north_m") for name in allowed):
            hint = (
                "positions are north_m and east_m, metres from a point of your own, or "
                "latitude_deg and longitude_deg, decimal degrees."
            )
        raise ConfigError(f"unknown key {path}.{key}; {hint}".replace(" .", " "))


class TomlTable:
    """A TOML table that knows its path and which of its keys have been read."""

    def __init__(self, data: Any, path: str) -> None:
        if not isinstance(data, dict):
            raise ConfigError(f"{path} must be a table; received {data!r}.")
        self._data, self._path, self._read = data, path, set[str]()

    def where(self, key: str) -> str:
        """The full path of a key."""
        return f"{self._path}.{key}" if self._path else key

    def get(self, key: str, default: Any = _REQUIRED) -> Any:
        """The raw value of a key."""
        self._read.add(key)
        if key in self._data:
            return self._data[key]
        if default is _REQUIRED:
            others = [name for name in self._data if name not in self._read]
            rest = f" Other keys there: {', '.join(others)}." if others else ""
            raise ConfigError(f"{self.where(key)} is missing.{rest}")
        return default

    def only(self, allowed: Sequence[str]) -> None:
        """Refuse other keys at once, before one that is missing is complained of."""
        others = [key for key in self._data if key not in allowed]
        refuse_unknown(others, list(allowed), self._path)

    def number(self, key: str, default: Any = _REQUIRED) -> float:
        """A number."""
        return number(self.get(key, default), self.where(key))

    def whole(self, key: str, default: Any = _REQUIRED) -> int:
        """A whole number."""
        return whole_number(self.get(key, default), self.where(key))

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        """A string."""
        value = self.get(key, default)
        if not isinstance(value, str):
            raise ConfigError(f"{self.where(key)} must be text; received {value!r}.")
        return value

    def numbers(
        self, key: str, default: Any = _REQUIRED, length: int = 0
    ) -> list[float]:
        """A list of numbers; one number stands for `length` equal ones, if given."""
        value = self.get(key, default)
        if not isinstance(value, list):
            return [number(value, self.where(key))] * (length or 1)
        if length and len(value) != length:
            raise ConfigError(
                f"{self.where(key)} must have {length} numbers; received {len(value)}."
            )
        return [number(v, f"{self.where(key)}[{i}]") for i, v in enumerate(value)]

    def rows(self, key: str) -> list[list[float]]:
        """Rows of numbers, all of one length."""
        value = self.get(key)
        if not isinstance(value, list) or not value:
            raise ConfigError(
                f"{self.where(key)} must be a list of rows of numbers; received "
                f"{value!r}."
            )
        rows = TomlTable({str(n): row for n, row in enumerate(value)}, self.where(key))
        first = rows.numbers("0")
        return [rows.numbers(str(n), length=len(first)) for n in range(len(value))]

    def table(self, key: str) -> "TomlTable":
        """A table, empty if it is not there."""
        return TomlTable(self.get(key, {}), self.where(key))

    def tables(self, key: str) -> list["TomlTable"]:
        """An array of tables, empty if it is not there."""
        value = self.get(key, [])
        if not isinstance(value, list):
            raise ConfigError(
                f"{self.where(key)} must be an array of tables, [[{self.where(key)}]]."
            )
        return [TomlTable(v, f"{self.where(key)}[{i}]") for i, v in enumerate(value)]

    def rest(self) -> dict[str, Any]:
        """Keys and values that have not been read yet, from now on counted as read."""
        left = {k: v for k, v in self._data.items() if k not in self._read}
        self._read.update(left)
        return left

    def close(self) -> None:
        """Refuse keys that were not read."""
        left = [k for k in self._data if k not in self._read]
        refuse_unknown(left, sorted(self._read - set(left)), self._path)


def reason(error: Exception) -> str:
    """The complaint of the operating system, without its number and the path."""
    text = error.strerror if isinstance(error, OSError) else None
    return text[0].lower() + text[1:] if text else str(error)


def file_text(path: str | Path) -> str:
    """The text of a file in UTF-8, without the mark that some editors put before it.

    Raises:
        OSError: it cannot be read.
        ConfigError: it is not UTF-8.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: cannot be read: not utf-8 text ({error.reason}, byte "
            f"{error.start}). Save it in that encoding."
        ) from error


def read_toml(path: str | Path) -> dict[str, Any]:
    """Parse a TOML file.

    Raises:
        ConfigError: it is missing, cannot be read, or is not TOML (with the line).
    """
    try:
        return tomllib.loads(file_text(path))
    except FileNotFoundError as error:
        place = Path(path).absolute().parent
        looked = "" if Path(path).is_absolute() else f" Looked in {place}."
        raise ConfigError(f"{path}: no such file.{looked}") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {reason(error)}.") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}.") from error
