"""Modes, controllability and zero dynamics of a linearised glider; host side."""

import dataclasses

import numpy as np
import scipy.linalg

from jaxglider.signals import CHANNELS
from jaxglider.trim.linear_model import STATES

LATERAL = ("roll", "heading", "sway", "roll_rate", "yaw_rate")
"""States that a glider in the vertical plane does not leave at zero."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """One natural motion, an eigenvalue λ of A or a pair of them.

    Attributes:
        eigenvalue: λ [1/s]; of a pair, the one with the positive imaginary part.
        lateral: share of it in the lateral states, from 0 to 1.
        reach: |wᴴ b| for each input at its limit, with the left eigenvector w scaled to
            the unit right one: how fast a jump of the input sets the mode off.
        distance: smallest singular value of [A − λ, B]: how far from uncontrollable.
    """

    eigenvalue: complex
    lateral: float
    reach: tuple[float, float, float]
    distance: float

    def time_constant(self) -> float:
        """Time in which it grows or decays by the factor e [s]."""
        real = self.eigenvalue.real
        return float("inf") if real == 0.0 else 1.0 / abs(real)

    def period(self) -> float | None:
        """Period of its oscillation [s], or None."""
        turning = abs(self.eigenvalue.imag)
        return 2 * np.pi / turning if turning > 0.0 else None


@dataclasses.dataclass(frozen=True)
class Analysis:
    """Natural motions of a linearised glider, and the reach of its commands.

    Attributes:
        modes: modes, slowest first; depth and heading by themselves, which rest, left
            out.
        rank: rank of the controllability matrix, by the test of each eigenvalue.
        order: rank at which everything is controllable.
    """

    modes: tuple[Mode, ...]
    rank: int
    order: int

    def stable(self) -> bool:
        """Whether every mode decays."""
        return all(mode.eigenvalue.real < 0.0 for mode in self.modes)


def analyse(a: np.ndarray, b: np.ndarray, limits: np.ndarray) -> Analysis:
    """Modes and controllability.

    Args:
        a: A of `linearise`.
        b: B of `linearise`.
        limits: limits of the three inputs [kg, m, rad].
    """
    a, b = np.asarray(a, float), np.asarray(b, float) * np.asarray(limits, float)
    moving = [i for i, name in enumerate(STATES) if name not in ("depth", "heading")]
    inner, driven = a[np.ix_(moving, moving)], b[moving]
    values, left, right = scipy.linalg.eig(inner, left=True)
    sideways = [STATES[i] in LATERAL for i in moving]
    modes = []
    for n in np.argsort(-values.real):
        if values[n].imag < 0.0:
            continue
        scale = np.vdot(left[:, n], right[:, n])
        share = np.sum(np.abs(right[sideways, n]) ** 2)
        modes.append(
            Mode(
                eigenvalue=complex(values[n]),
                lateral=float(share / np.sum(np.abs(right[:, n]) ** 2)),
                reach=tuple(np.abs(left[:, n].conj() @ driven / scale).tolist()),
                distance=_distance(inner, driven, values[n]),
            )
        )
    return Analysis(tuple(modes), _rank(a, b), len(a))


def _distance(a: np.ndarray, b: np.ndarray, value: complex) -> float:
    whole = np.hstack([a - value * np.eye(len(a)), b])
    return float(np.linalg.svd(whole, compute_uv=False)[-1])


def _rank(a: np.ndarray, b: np.ndarray) -> int:
    """The least rank of [A − λ, B] over the eigenvalues λ (the PBH test)."""
    ranks = [
        np.linalg.matrix_rank(np.hstack([a - value * np.eye(len(a)), b]), tol=1e-9)
        for value in np.linalg.eigvals(a)
    ]
    return int(min(ranks))


def transmission_zeros(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Eigenvalues [1/s] of the zero dynamics: what moves while all outputs are held.

    The finite s for which [[A − s, B], [C, 0]] is singular, with depth, pitch and
    heading as outputs.

    Args:
        a: A of `linearise`.
        b: B of `linearise`.
    """
    outputs = [STATES.index(name) for name in CHANNELS]
    n, m = b.shape
    whole = np.block([[a, b], [np.eye(n)[outputs], np.zeros((m, m))]])
    shifted = np.zeros_like(whole)
    shifted[:n, :n] = np.eye(n)
    eigenvalues = scipy.linalg.eig(whole, shifted, right=False)
    finite = eigenvalues[np.isfinite(eigenvalues) & (np.abs(eigenvalues) < 1e4)]
    return finite[np.argsort(-finite.real)]


def zero_dynamics(
    a: np.ndarray, b: np.ndarray, start: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """The states over time while the commands hold depth, pitch and heading exactly.

    Each output y obeys y'' = C A² x + C A B U: the command that makes it zero keeps
    what starts with y = y' = 0 there.

    Args:
        a: A of `linearise`.
        b: B of `linearise`.
        start: a state; what the outputs would move with is projected out.
        times: evenly spaced times [s].

    Returns:
        One row a time.
    """
    c = np.eye(len(a))[[STATES.index(name) for name in CHANNELS]]
    lifted = np.vstack([c, c @ a])
    held = a - b @ np.linalg.solve(c @ a @ b, c @ a @ a)
    x = start - np.linalg.pinv(lifted) @ lifted @ start
    advance = scipy.linalg.expm(held * (times[1] - times[0]))
    rows = [x]
    for _ in times[1:]:
        rows.append(advance @ rows[-1])
    return np.array(rows)
