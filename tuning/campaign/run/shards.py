"""Shards of a campaign joined."""

import dataclasses
from pathlib import Path

import numpy as np

from tuning.campaign.run.store import (
    Manifest,
    opened,
    read_manifest,
    read_rows,
    whole_rows,
)
from tuning.reporting.console import note

_AT_ONCE = 4096


def read_shards(folders: list[Path]) -> list[tuple[Path, Manifest]]:
    """The shards in the order of their members.

    Raises:
        ValueError: they are not all of one campaign, overlap, leave a gap, or one is
            not finished.
    """
    shards = [(folder, read_manifest(folder)) for folder in dict.fromkeys(folders)]
    shards.sort(key=lambda shard: shard[1].first)
    first = shards[0]
    for folder, manifest in shards:
        others = manifest.settings.differences(first[1].settings)
        if others:
            raise ValueError(
                f"{folder} is not of the same campaign as {first[0]}: their options "
                f"differ ({', '.join(others)}). Merge shards that were made with the "
                "same options."
            )
        count = whole_rows(folder / "rows.bin", manifest.row_type(), manifest.first)
        if count != manifest.last - manifest.first:
            raise ValueError(
                f"{folder} holds {count} of its {manifest.last - manifest.first} "
                "members; finish it with --resume first."
            )
    at = 0
    for folder, manifest in shards:
        if manifest.first != at:
            what = "are missing" if manifest.first > at else "are there twice"
            low, high = sorted((at, manifest.first))
            raise ValueError(
                f"members {low} to {high - 1} {what} (before {folder}); give every "
                "shard once."
            )
        at = manifest.last
    total = first[1].settings.members
    if at != total:
        raise ValueError(
            f"members {at} to {total - 1} are missing; give every shard once."
        )
    return shards


def join(
    shards: list[tuple[Path, Manifest]], out: Path, *, overwrite: bool
) -> Manifest:
    """Write the rows of all shards to a folder, and its manifest.

    Args:
        shards: folders and manifests, in the order of the members.
        out: folder to write to.
        overwrite: flag, a campaign there is discarded.

    Raises:
        ValueError: the folder holds a campaign, or is one of the shards.
        OSError: it cannot be written.
    """
    if out.resolve() in [folder.resolve() for folder, _ in shards]:
        raise ValueError(f"--out {out} is one of the shards; give another folder.")
    if (out / "campaign.json").exists():
        if not overwrite:
            raise ValueError(
                f"--out {out} holds a campaign; discard it by --overwrite, or give "
                "another folder."
            )
        (out / "rows.bin").unlink(missing_ok=True)
    manifest = shards[0][1]
    for folder, other in shards[1:]:
        for key in ("versions", "hardware"):
            if other.about[key] != manifest.about[key]:
                note(f"{folder} was made with other {key} than {shards[0][0]}.")
    total = manifest.settings.members
    merged = dataclasses.replace(manifest, first=0, last=total)
    merged.write(out)
    with opened(out, merged.row_type(), 0) as store:
        for folder, shard in shards:
            rows = read_rows(folder / "rows.bin", merged.row_type())
            rows = rows[: shard.last - shard.first]
            for start in range(0, len(rows), _AT_ONCE):
                store.append(np.array(rows[start : start + _AT_ONCE]))
    return merged
