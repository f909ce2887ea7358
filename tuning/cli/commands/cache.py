"""The command that shows and clears the cache of compiled programs."""

import argparse
import shutil
import sys
from pathlib import Path

from jaxglider.core.compiler import cache_folder
from tuning.reporting.exit_codes import OK


def cache(options: argparse.Namespace) -> int:
    """`jaxglider cache`: where compiled programs are kept, how large; `--clear` them.

    Raises:
        OSError: a file cannot be removed.
    """
    # Beside this processor's folder lie those of others that share the home folder.
    own = cache_folder()
    if own is None:
        sys.stdout.write(
            "there is no cache: neither XDG_CACHE_HOME nor a home folder is set, so "
            "programs are compiled anew by each command.\n"
        )
        return OK
    folder = own.parent
    files = [path for path in folder.rglob("*") if path.is_file()]
    size = sum(_size(path) for path in files) / 2**20
    if options.clear and folder.exists():
        shutil.rmtree(folder)
    did = "cleared" if options.clear else "holds"
    sys.stdout.write(f"{folder}: {did} {len(files)} files, {size:.1f} MiB.\n")
    return OK


def _size(path: Path) -> int:
    """Bytes of a file, which another process may just have removed."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
