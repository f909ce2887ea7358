"""Whether a folder may hold a campaign."""

from pathlib import Path

from tuning.sweep.store import Manifest, read_manifest


def prepare(folder: Path, manifest: Manifest, *, resume: bool, overwrite: bool) -> None:
    """See that the folder holds this campaign or none.

    Raises:
        ValueError: it holds another one, or this one and it is not to be gone on with.
    """
    if (folder / "campaign.json").exists() and not overwrite:
        if not resume:
            raise ValueError(
                f"--out {folder} holds a campaign; go on with it by --resume, discard "
                "it by --overwrite, or give another folder."
            )
        kept = read_manifest(folder)
        same_part = (kept.first, kept.last) == (manifest.first, manifest.last)
        if kept.settings != manifest.settings or not same_part:
            raise ValueError(
                f"--resume: {folder} holds a campaign with other options "
                f"({', '.join(_differences(kept, manifest))}); repeat those, or give "
                "another folder."
            )
        return
    for name in ("rows.bin", "sobol.bin"):
        (folder / name).unlink(missing_ok=True)
    manifest.write(folder)


def _differences(kept: Manifest, wanted: Manifest) -> list[str]:
    names = [
        name
        for name, value in vars(kept.settings).items()
        if value != getattr(wanted.settings, name)
    ]
    parts = (kept.first, kept.last) != (wanted.first, wanted.last)
    return [*names, "shard"] if parts and "members" not in names else names
