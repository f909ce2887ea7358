"""A controller that is another program: software in the loop.

The program is asked tick by tick over its standard input and answers on its standard
output, a line of text each way, numbers apart by blanks:

| who | line |
|---|---|
| simulator | `jaxglider-sil 1 DT`, once; DT is the control tick [s] |
| program | `ready`, or `error` and a reason |
| simulator | 13 numbers: time and the fields of `signals.GliderState` in order |
| program | buoyancy_mass, mass_position, mass_angle, status |

SI units and radians as in `signals`; time is from the start of the run. The program
ends when its input does. Guidance and observer are its own; the simulator only judges.
"""

import contextlib
import os
import selectors
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import io_callback

from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.core.containers import Scalar
from jaxglider.signals import (
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    zeros,
)
from jaxglider.simulation.origin import MAP_ZERO, Origin

HELLO = "jaxglider-sil 1"
TIMEOUT = 5.0
"""Longest wait for an answer [s]."""


class PipeError(OSError):
    """The program could not be run or did not answer as it should."""


class ChildProcess:
    """A running controller program.

    Attributes:
        statuses: number of ticks with each status word that is not zero.
        failure: account of the failure, if there was one.
    """

    def __init__(self, command: Sequence[str], dt: float, timeout: float = TIMEOUT):
        """Start the program and shake hands.

        Args:
            command: the program and its arguments.
            dt: control tick [s].
            timeout: longest wait for an answer [s].

        Raises:
            PipeError: it cannot be started, refuses, or does not answer.
        """
        self.statuses: dict[int, int] = {}
        self.failure: PipeError | None = None
        self._name, self._timeout, self._waiting = command[0], timeout, b""
        self._tick = 0
        # A file, not a pipe: nobody has to empty it.
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        program = command[0]
        if os.sep not in program and Path(program).is_file():
            program = os.path.join(os.curdir, program)
        try:
            self._process = subprocess.Popen(
                [program, *command[1:]],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
            )
        except OSError as error:
            self._errors.close()
            raise PipeError(
                f"--controller-binary {self._name} cannot be started: "
                f"{error.strerror or error}. Give the path of an executable file."
            ) from error
        assert self._process.stdout is not None
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._process.stdout, selectors.EVENT_READ)
        try:
            answer = self._ask(f"{HELLO} {dt!r}")
            if answer != "ready":
                raise PipeError(
                    f"{self._name} refused to start: it answered {answer!r} to "
                    f"'{HELLO} {dt!r}'; expected 'ready'."
                )
        except PipeError:
            self.close()
            raise

    def command(self, *row: Any) -> np.ndarray:
        """The command for a measurement; NaN once the program has failed.

        Args:
            row: time and the twelve states.
        """
        if self.failure is not None:
            return np.full(3, np.nan)
        try:
            answer = self._ask(" ".join(f"{float(x):.17g}" for x in row))
            return self._understood(answer)
        except PipeError as error:
            self.failure = error
            return np.full(3, np.nan)

    def _understood(self, answer: str) -> np.ndarray:
        try:
            *command, status = answer.split()
            numbers = np.array([float(x) for x in command])
            word = int(status)
        except ValueError:
            numbers, word = np.empty(0), 0
        if numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise PipeError(
                f"{self._name} answered {answer[:200]!r} at tick {self._tick}; "
                "expected three finite numbers and a status word."
            )
        if word:
            self.statuses[word] = self.statuses.get(word, 0) + 1
        self._tick += 1
        return numbers

    def _ask(self, line: str) -> str:
        """Send a line and wait for the answer."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()
        except OSError as error:
            raise self._ended() from error
        end = time.monotonic() + self._timeout
        while b"\n" not in self._waiting:
            left = end - time.monotonic()
            if left <= 0.0 or not self._selector.select(left):
                raise PipeError(
                    f"{self._name} did not answer within {self._timeout:g} s at tick "
                    f"{self._tick}. Each line needs an answer, flushed at once."
                )
            assert self._process.stdout is not None
            got = os.read(self._process.stdout.fileno(), 65536)
            if not got:
                raise self._ended()
            self._waiting += got
        answer, _, self._waiting = self._waiting.partition(b"\n")
        return answer.decode(errors="replace").strip()

    def _ended(self) -> PipeError:
        """The error about a program that has ended."""
        try:
            code: int | str = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            code = "unknown"
        self._errors.seek(0)
        complaint = self._errors.read().decode(errors="replace").strip()
        last = f" Its last words: {complaint.splitlines()[-1]}" if complaint else ""
        return PipeError(
            f"{self._name} ended at tick {self._tick} with exit code {code}.{last}"
        )

    def close(self) -> None:
        """End the program."""
        self._selector.close()
        with contextlib.suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._errors.close()


class PipeController(AbstractController):
    """The controller as the simulation sees it: it asks the program.

    A program has a memory of its own: run it once, tick after tick, not under `vmap`.

    Attributes:
        funnel: funnel that errors are judged by, or None.
        peer: the program.
        model: None; the program keeps its beliefs to itself.
        origin: place that the simulator's positions count from; the program is told
            true ones.
    """

    funnel: Funnel | None
    peer: ChildProcess = eqx.field(static=True)
    origin: Origin = eqx.field(static=True, default=MAP_ZERO)
    model: None = None

    def init(self) -> Scalar:
        """Ticks so far."""
        return jnp.zeros((), jnp.result_type(float))

    def step(
        self,
        state: Scalar,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], Scalar, ControlRecord]:
        """One tick."""
        error, _ = tracking_error(measurement, reference)
        s: GliderState = measurement.state
        shape = jax.ShapeDtypeStruct((3,), s.depth.dtype)
        row = (state * dt, *jax.tree.leaves(s))
        ask = _asking(self.peer, self.origin, shape.dtype)
        answer = io_callback(ask, shape, *row, ordered=True)
        wanted = Command(answer[0], answer[1], answer[2])
        return wanted, state + 1.0, ControlRecord(error, zeros(Channels, s.depth))


def _asking(peer: ChildProcess, origin: Origin, dtype: Any) -> Any:
    """The program's answer to time and states; positions are summed in double."""

    def ask(time: Any, north: Any, east: Any, *rest: Any) -> np.ndarray:
        place = float(north) + origin.north, float(east) + origin.east
        return peer.command(time, *place, *rest).astype(dtype)

    return ask
