"""Text files of places and water, and tables of comma-separated values in them."""

import csv
from pathlib import Path

from jaxglider.core.toml import ConfigError, file_text, reason


def text_of(path: Path) -> str:
    """The text of a file.

    Args:
        path: path of the file.

    Raises:
        ConfigError: it cannot be read, or is empty.
    """
    try:
        text = file_text(path)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {reason(error)}.") from error
    if not text.strip():
        raise ConfigError(f"{path} is empty.")
    return text


def csv_table(
    path: Path, text: str
) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Names of the columns, and each row by column with the number of its line.

    Blank lines, and those that begin with #, are left out.

    Args:
        path: path of the file, for the message.
        text: text of the file.

    Raises:
        ConfigError: a row has more or fewer values than the first line has names.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    reader = csv.reader((line for _, line in lines), skipinitialspace=True)
    head: list[str] = []
    rows = []
    try:
        for cells in reader:
            number = lines[reader.line_num - 1][0]
            if not head:
                head = [name.strip() for name in cells]
            elif len(cells) != len(head):
                raise ConfigError(
                    f"{path}: line {number} has {len(cells)} values; the first has "
                    f"{len(head)} names: {', '.join(head)}."
                )
            else:
                rows.append((number, dict(zip(head, cells, strict=True))))
    except csv.Error as error:
        raise ConfigError(f"{path} cannot be read as CSV: {error}.") from error
    return head, rows
