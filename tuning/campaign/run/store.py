"""Rows on disk: appended chunk by chunk, whole up to the last one whatever happens.

A folder holds `campaign.json`, which says what the campaign is, and `rows.bin`, rows of
one size in the order of the members, each with a check sum. What a crash has left of a
row at the end is cut off when the campaign goes on, so that the file ends up the same,
byte for byte, as without the crash.
"""

import contextlib
import dataclasses
import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import reason
from jaxglider.files.writing import write_json
from tuning.campaign.run.campaign import Campaign, CampaignSettings, fingerprint_of
from tuning.campaign.run.rows import checksums, columns_of, row_type

FORMAT = 1
_AT_ONCE = 4096


class StoreFull(OSError):
    """Rows could not be written; those before are safe."""


@dataclasses.dataclass(frozen=True)
class Manifest:
    """Description of the campaign, beside the rows.

    Attributes:
        settings: settings of the campaign.
        labels: labels of the sets of gains.
        quantities: name, path and unit of what is uncertain.
        first: number of the first member here.
        last: number after the last one.
        about: versions and hardware that made the rows.
        has_flight: flag, yos are flown, and more is kept of a run.
    """

    settings: CampaignSettings
    labels: tuple[str, ...]
    quantities: tuple[tuple[str, str, str], ...]
    first: int
    last: int
    about: dict[str, Any]
    has_flight: bool = False

    @classmethod
    def of(
        cls, campaign: Campaign, first: int, last: int, about: dict[str, Any]
    ) -> "Manifest":
        """The manifest of members `first` to `last` of a campaign."""
        return cls(
            campaign.settings,
            campaign.labels,
            tuple((q.name, q.path, q.unit) for q in campaign.uncertainty.quantities),
            first,
            last,
            about,
            campaign.has_flight,
        )

    def row_type(self) -> np.dtype:
        """Type of the rows."""
        return row_type(len(self.quantities), len(self.labels), len(self.columns))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of what is kept of a run."""
        return columns_of(flight=self.has_flight)

    def write(self, folder: Path) -> None:
        """Write `campaign.json`."""
        table = dataclasses.asdict(self)
        del table["has_flight"]
        head = {"format": FORMAT, "fingerprint": self.settings.fingerprint()}
        write_json(
            folder / "campaign.json", {**head, "columns": list(self.columns), **table}
        )


def read_manifest(folder: Path) -> Manifest:
    """The manifest in a folder.

    Raises:
        ValueError: there is none, or it cannot be used.
    """
    path = folder / "campaign.json"
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(
            f"{folder} holds no campaign: there is no {path.name}. `jaxglider sweep "
            "--out` makes one."
        ) from None
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read ({reason(error)}).") from error
    try:
        kept = table["columns"]
        flights = [x for x in (False, True) if kept == list(columns_of(flight=x))]
        if table["format"] != FORMAT or not flights:
            raise ValueError("it was made by another version; run the sweep anew")
        quantities = tuple(tuple(entry) for entry in table["quantities"])
        manifest = Manifest(
            CampaignSettings.of(table["settings"]),
            tuple(table["labels"]),
            quantities,
            table["first"],
            table["last"],
            table["about"],
            flights[0],
        )
        if fingerprint_of(table["settings"]) != table["fingerprint"]:
            raise ValueError("it has been changed by hand")
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} cannot be used: {error}.") from error
    return manifest


class Store:
    """The rows of one folder, open for appending by one process at a time."""

    def __init__(self, path: Path, kind: np.dtype, first: int) -> None:
        """Open or make a file, and cut off what a crash has left at its end.

        Args:
            path: path of the file.
            kind: type of the rows.
            first: number of the first member.

        Raises:
            ValueError: another process writes it.
            OSError: it cannot be written.
        """
        self.path, self._kind = path, kind
        self._file = open(path, "a+b", buffering=0)  # noqa: SIM115
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise ValueError(f"{path} is being written by another process.") from error
        self.count = whole_rows(path, kind, first)
        self.cut = os.path.getsize(path) - self.count * kind.itemsize
        os.ftruncate(self._file.fileno(), self.count * kind.itemsize)

    def append(self, rows: np.ndarray) -> None:
        """Add rows and see them safe.

        Raises:
            StoreFull: they cannot be written; the file is as before.
        """
        data = memoryview(rows.tobytes())
        try:
            while data:
                data = data[self._file.write(data) or 0 :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file.fileno(), self.count * self._kind.itemsize)
            raise StoreFull(
                f"{self.path} cannot be written ({reason(error)}); {self.count} "
                "members are safe. Make room and go on with --resume."
            ) from error
        self.count += len(rows)

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def rows(self) -> np.ndarray:
        """All rows, mapped from the file."""
        return read_rows(self.path, self._kind)[: self.count]


@contextlib.contextmanager
def opened(folder: Path, kind: np.dtype, first: int) -> Iterator[Store]:
    """The store of a folder, closed at the end.

    Args:
        folder: folder of the campaign.
        kind: type of the rows.
        first: number of the first member.
    """
    store = Store(folder / "rows.bin", kind, first)
    try:
        yield store
    finally:
        store.close()


def read_rows(path: Path, kind: np.dtype) -> np.ndarray:
    """The rows of a file, mapped; what is left of a row at the end is not seen."""
    count = os.path.getsize(path) // kind.itemsize if path.exists() else 0
    if count == 0:
        return np.zeros(0, kind)
    return np.memmap(path, kind, "r", shape=(count,))


def whole_rows(path: Path, kind: np.dtype, first: int) -> int:
    """Number of rows that are whole and in order, from the start.

    Args:
        path: path of the file.
        kind: type of the rows.
        first: number of the first member.
    """
    rows = read_rows(path, kind)
    for start in range(0, len(rows), _AT_ONCE):
        part = np.array(rows[start : start + _AT_ONCE])
        expected = np.arange(first + start, first + start + len(part))
        wrong = (part["check"] != checksums(part)) | (part["member"] != expected)
        if np.any(wrong):
            return start + int(np.argmax(wrong))
    return len(rows)


def prepare(folder: Path, manifest: Manifest, *, resume: bool, overwrite: bool) -> None:
    """Check that the folder holds this campaign or none.

    Args:
        folder: folder of the campaign.
        manifest: manifest of this campaign.
        resume: flag, this campaign may be there already.
        overwrite: flag, any campaign there is discarded.

    Raises:
        ValueError: it holds another one, or this one and it is not to be gone on with.
    """
    if (folder / "campaign.json").exists() and not overwrite:
        if not resume:
            raise ValueError(
                f"--out {folder} holds a campaign; go on with it by --resume, discard "
                "it by --overwrite, or give another folder."
            )
        older = read_manifest(folder)
        _check_that_it_goes_on(folder, older, manifest)
        if older.settings.differences(manifest.settings):
            dataclasses.replace(manifest, about=older.about).write(folder)
        return
    for name in ("rows.bin", "sobol.bin"):
        (folder / name).unlink(missing_ok=True)
    manifest.write(folder)


def _check_that_it_goes_on(folder: Path, older: Manifest, newer: Manifest) -> None:
    """Refuse what would not leave the rows that are there as they are.

    Raises:
        ValueError: says why.
    """
    others = [
        name
        for name in older.settings.differences(newer.settings)
        # How many there are to be changes no row, and neither does when to stop.
        if name not in ("members", "until_ci")
    ]
    had, wanted = older.settings.members, newer.settings.members
    part = (older.first, older.last)
    if had == wanted and part != (newer.first, newer.last):
        others.append("shard")
    if others:
        raise ValueError(
            f"--resume: {folder} holds a campaign with other options "
            f"({', '.join(others)}); repeat those, or give another folder."
        )
    if wanted < had:
        raise ValueError(
            f"--resume: {folder} holds a campaign of {had} members; received --members "
            f"{wanted}. Give {had} or more, or another folder."
        )
    if wanted > had and older.settings.design == "latin-hypercube":
        raise ValueError(
            f"--resume: a latin-hypercube places each member by how many there are, so "
            f"that one of {had} cannot grow to {wanted}; give another folder."
        )
    if wanted > had and (part, newer.first) != ((0, had), 0):
        raise ValueError(
            f"--resume: {folder} holds a part of a campaign of {had} members, and each "
            f"part of one of {wanted} would begin elsewhere; merge the parts and go on "
            "with the whole, or give another folder."
        )
