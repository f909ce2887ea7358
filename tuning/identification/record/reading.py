"""Any files of one flight, read by the reader they need and put into one record."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from tuning.identification.record.cleaning import clean, flipped
from tuning.identification.record.flight_record import Finding, FlightRecord
from tuning.identification.record.netcdf import read_netcdf
from tuning.identification.record.seaexplorer import is_seaexplorer, read_seaexplorer
from tuning.identification.record.seawater import with_density
from tuning.identification.record.slocum import BINARY, read_binary, read_table
from tuning.identification.record.table import read_csv


def read_record(
    paths: str | Path | Sequence[str | Path], flip: Sequence[str] = ()
) -> FlightRecord:
    """Read the files of one flight, clean it, and compute its density.

    What an earlier file has counts; a later one adds channels that are missing, such as
    a speed through the water beside the vehicle's own files. A folder stands for all
    files in it that a reader knows.

    Args:
        paths: files or folders: Slocum .dbd and .ebd (and their short forms),
            gliderflight's .npy, SeaExplorer .gli. and .pld., NetCDF, or a table (.csv).
        flip: names of channels whose sign is turned.

    Raises:
        ValueError: a file is of no known kind or cannot be used.
        OSError: a file cannot be read.
    """
    files = _files([paths] if isinstance(paths, str | Path) else list(paths))
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    parts: list[FlightRecord] = []
    for kind in dict.fromkeys(_kind(path) for path in files):
        parts += _read(kind, [path for path in files if _kind(path) == kind])
    record = clean(_merged(parts, digest.hexdigest()))
    return with_density(flipped(record, tuple(flip)) if flip else record)


def _files(paths: Sequence[str | Path]) -> list[Path]:
    """Files in order; folders opened.

    Raises:
        ValueError: none is there, or a folder has none that is known.
    """
    files: list[Path] = []
    for given in paths:
        path = Path(given)
        if path.is_dir():
            known = [p for p in sorted(path.iterdir()) if p.is_file() and _known(p)]
            if not known:
                raise ValueError(
                    f"{path}: no file of a flight in this folder; {_KINDS_TEXT}."
                )
            files += known
        elif not path.exists():
            raise FileNotFoundError(f"{path}: no such file. Give files of a flight.")
        else:
            files.append(path)
    if not files:
        raise ValueError(f"files of a flight must be given; {_KINDS_TEXT}.")
    return files


_KINDS_TEXT = (
    "known are Slocum .dbd/.ebd, .sbd/.tbd, gliderflight's .npy, SeaExplorer .gli. and "
    ".pld. files, NetCDF (.nc), and tables (.csv)"
)


def _known(path: Path) -> bool:
    try:
        return bool(_kind(path))
    except ValueError:
        return False


def _kind(path: Path) -> str:
    """The reader that a file needs, by its name.

    Raises:
        ValueError: there is none.
    """
    ending = path.suffix.lower()
    if is_seaexplorer(path):
        return "seaexplorer"
    if ending in BINARY:
        return "binary"
    kinds = {".npy": "npy", ".nc": "netcdf", ".csv": "table"}
    if ending in kinds:
        return kinds[ending]
    raise ValueError(f"{path}: no reader for this kind of file; {_KINDS_TEXT}.")


def _read(kind: str, files: list[Path]) -> list[FlightRecord]:
    if kind == "binary":
        return [read_binary(files)]
    if kind == "seaexplorer":
        return [read_seaexplorer(files)]
    if kind == "netcdf":
        return [read_netcdf(files)]
    return [(read_table if kind == "npy" else read_csv)(path) for path in files]


def _merged(parts: Sequence[FlightRecord], digest: str) -> FlightRecord:
    """One record of several: each channel from the first that has it."""
    channels, findings = dict(parts[0].channels), list(parts[0].findings)
    for part in parts[1:]:
        findings += part.findings
        new = {n: s for n, s in part.channels.items() if n not in channels}
        if new:
            findings.append(Finding(part.name, f"gave {', '.join(new)}."))
        channels |= new
    kind = " + ".join(dict.fromkeys(part.kind for part in parts))
    return FlightRecord(parts[0].name, kind, channels, tuple(findings), digest)
