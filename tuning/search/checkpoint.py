"""Checkpoints of a descent: resumed, it goes on bit for bit as if never stopped."""

import dataclasses
import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.toml import reason
from jaxglider.files.writing import replacing
from tuning.search.settings import State, Step

_BROKEN = (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile)


class Checkpoint:
    """The last state of a descent and its history, in one file."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        """Use a file.

        Args:
            path: path of the checkpoint, ending in .npz.
            fingerprint: hash of the configuration the descent depends on.
        """
        self._path, self._fingerprint = path, fingerprint

    def save(
        self, state: State, history: list[Step], rounds: Sequence[Any] = ()
    ) -> None:
        """Replace the checkpoint; the old one stays until the new one is complete.

        Args:
            state: state of the descent.
            history: steps so far.
            rounds: adversarial rounds so far, as dataclasses of plain numbers.
        """
        rows = [
            {**dataclasses.asdict(step), "free": np.asarray(step.free).tolist()}
            for step in history
        ]
        leaves: dict[str, Any] = {
            f"leaf{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))
        }
        about = json.dumps(
            {
                "fingerprint": self._fingerprint,
                "steps": rows,
                "rounds": [dataclasses.asdict(one) for one in rounds],
            }
        )
        with replacing(self._path) as temporary:
            np.savez(temporary, about=about, **leaves)

    def about(self) -> dict[str, Any]:
        """Fingerprint, steps and rounds, read without anything compiled.

        Raises:
            ValueError: there is no checkpoint, it is broken, or it belongs to another
                configuration.
        """
        if not self._path.exists():
            raise ValueError(f"--resume: no {self._path}; run without --resume.")
        try:
            with np.load(self._path) as data:
                about: dict[str, Any] = json.loads(str(data["about"]))
        except _BROKEN as error:
            raise self._unreadable(error) from error
        if about["fingerprint"] != self._fingerprint:
            raise ValueError(
                f"--resume: {self._path} was made with other options; repeat those, "
                "or run without --resume."
            )
        return about

    def _unreadable(self, error: Exception) -> ValueError:
        return ValueError(
            f"--resume: {self._path} cannot be read ({reason(error)}); run without "
            "--resume."
        )

    def load(self, like: State) -> tuple[State, list[Step]]:
        """The last state and its history.

        Args:
            like: a state of the same shape.

        Raises:
            ValueError: there is no checkpoint, it is broken, or it belongs to another
                configuration.
        """
        about = self.about()
        old, structure = jax.tree.flatten(like)
        try:
            with np.load(self._path) as data:
                new = [jnp.asarray(data[f"leaf{i}"]) for i in range(len(old))]
        except _BROKEN as error:
            raise self._unreadable(error) from error
        steps = [
            Step(**{**row, "free": jnp.asarray(row["free"], like.chosen_free.dtype)})
            for row in about["steps"]
        ]
        return jax.tree.unflatten(structure, new), steps
