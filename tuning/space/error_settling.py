"""Gains whose error settles in time on the surface, with Tian's pairing of exponents.

On s = 0 the transformed error follows ε'' = −k₁ φ(ε) − k₂ ψ(ε'), φ and ψ the sums of a
power below one, the identity and a power above one. With Tian's pairing it settles in a
time that no start exceeds; no closed form is known. Held here is

T_slow(k₁/k₂, ρ) + T_brake(ρ)/k₂,  T_slow(q, ρ) = ∫₀^∞ dx/ψ⁻¹(q φ(x)),
T_brake(ρ) = ∫₀^∞ dv/ψ(v).

The second is the time in which ε' brakes from infinitely fast; from then on ε' is above
the curve k₂ ψ(|ε'|) = k₁ φ(ε), on which ε'' = 0, and falls at least as fast as along it
while ε keeps its sign. What an overshoot adds is not covered by that argument: with
k₁ < ¾ k₂² the sum was found above the settling time of every simulated start, by 5 % to
several times. With the paper's pairing T_slow is infinite, and nothing is held.
"""

import functools
from operator import attrgetter
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxglider.control.fxtppc import SURFACE_CONSTANT
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.bijections import Above, Within
from tuning.space.coordinate import Coordinate
from tuning.space.edges import Edge

ERROR = "error-settles"

_RHO = np.linspace(0.1, 0.95, 35)
"""ρ for which the bound is tabulated, and the ends it is kept within."""
_RATIO = np.linspace(np.log(1e-3), np.log(1e4), 81)
"""log(k₁/k₂) for which it is."""
_REACH = 400.0
"""Largest |log x| and |log v| of the integrals."""
_MARGIN = 0.98
"""Share of the required time that the tables aim at; interpolation errs by less."""
_TOP = 0.7
"""k₁ over k₂² up to which there must be room."""


def error_bound(k1: float, k2: float, rho: float) -> float:
    """Bound on the settling time of ε on s = 0 [s], with Tian's pairing.

    Args:
        k1: k₁.
        k2: k₂.
        rho: ρ.
    """
    slow = np.exp(_log_slow(np.asarray([np.log(k1 / k2)]), rho)[0])
    return float(slow + _brake(rho) / k2)


def error_coordinates(
    loop: ClosedLoop, owner: str, time: float, names: Any
) -> tuple[dict[str, Coordinate], list[str]]:
    """Coordinates that keep the bounds on surface and error, and remarks.

    Args:
        loop: closed loop that the search starts from.
        owner: path of the gains of a channel.
        time: required settling time [s].
        names: paths of the tuned numbers.
    """
    path = {name: f"{owner}.{name}" for name in ("rho", "mu", "k1", "k2")}
    rho = float(attrgetter(path["rho"])(loop))
    tuned = path["rho"] in names
    if path["k1"] not in names or path["k2"] not in names:
        return {}, [f"{ERROR}: not held for {owner}; tune its k1 and k2 together."]
    if not tuned and not _RHO[0] <= rho <= _RHO[-1]:
        return {}, [f"{ERROR}: not held for {owner}, whose rho is {rho:g}."]
    least, slow, brake = (jnp.asarray(x) for x in _tables(time))
    need = SURFACE_CONSTANT / time
    rule = (
        f"error on s = 0 settled after {time:g} s (Tian), surface too, and "
        "k1 < 3/4 k2^2"
    )

    def on_grid(values: Any, at: Any) -> Any:
        return jnp.interp(at, jnp.asarray(_RHO), values)

    def least_k2(at: Any, mu: Any) -> Any:
        # From here on k₁ = 0.7 k₂² keeps both bounds.
        surface = (jnp.sqrt(1.0 + 4.0 * _TOP * need * mu) - 1.0) / (2.0 * _TOP)
        return jnp.maximum(jnp.exp(on_grid(least, at)), surface)

    def ends(k2: Any, at: Any, mu: Any) -> tuple[Any, Any]:
        left = jnp.maximum(_MARGIN * time - on_grid(brake, at) / k2, 1e-3 * time)
        place = (at - _RHO[0]) / (_RHO[1] - _RHO[0])
        low = jnp.clip(jnp.floor(place), 0, len(_RHO) - 2).astype(int)
        share = place - low
        row = (1.0 - share) * slow[low] + share * slow[low + 1]
        ratio = jnp.interp(-jnp.log(left), -row, jnp.asarray(_RATIO))
        return jnp.maximum(jnp.exp(ratio) * k2, need * mu - k2), 0.75 * k2 * k2

    def holds(k1: float, k2: float, at: float, mu: float) -> bool:
        inside = 0.0 < k1 < 0.75 * k2 * k2 and need * mu <= (k1 + k2) * (1.0 + 1e-6)
        return inside and error_bound(k1, k2, at) <= time

    given = (path["rho"], path["mu"])
    found = {
        path["k2"]: Coordinate(
            path["k2"], Above(), Edge(least_k2, rule, lambda k2, *_: k2 > 0.0), given
        ),
        path["k1"]: Coordinate(
            path["k1"], Within(), Edge(ends, rule, holds), (path["k2"], *given)
        ),
    }
    if tuned:
        limits = float(_RHO[0]), float(_RHO[-1])
        found[path["rho"]] = Coordinate(
            path["rho"],
            Within(),
            Edge(lambda *_: limits, rule, lambda x, *_: limits[0] <= x <= limits[1]),
        )
    return found, []


@functools.cache
def _curves() -> tuple[np.ndarray, np.ndarray]:
    """log T_slow over ρ and log(k₁/k₂), and T_brake over ρ."""
    slow = np.stack([_log_slow(_RATIO, rho) for rho in _RHO])
    return slow, np.asarray([_brake(rho) for rho in _RHO])


@functools.cache
def _tables(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """log of the least k₂ that has room for a time, and the curves."""
    slow, brake = _curves()
    least = []
    for row, brakes in zip(slow, brake, strict=True):
        low, high = np.log(1e-3), np.log(1e4)
        for _ in range(60):
            middle = 0.5 * (low + high)
            k2 = np.exp(middle)
            bound = np.exp(np.interp(np.log(_TOP * k2), _RATIO, row)) + brakes / k2
            low, high = (low, middle) if bound < _MARGIN * time else (middle, high)
        least.append(high + 0.01)
    return np.asarray(least), slow, brake


def _log_slow(log_ratio: np.ndarray, rho: float) -> np.ndarray:
    """log T_slow at each log(k₁/k₂)."""
    over = 4.0 - 3.0 * rho
    x = np.linspace(-_REACH, _REACH, 2001)
    curve = _log_sum(x, rho / (2.0 - rho), over / (2.0 - rho))
    # ψ⁻¹ by its own table: log v over log ψ(v).
    v = np.linspace(-2.5 * _REACH, 2.5 * _REACH, 10001)
    speed = _log_sum(v, rho, over / (3.0 - 2.0 * rho))
    found = []
    for shift in log_ratio:
        integrand = np.exp(x - np.interp(shift + curve, speed, v))
        found.append(np.log(np.trapezoid(integrand, x)))
    return np.asarray(found)


def _brake(rho: float) -> float:
    """T_brake: the time in which v' = −ψ(v) comes from infinity to zero [s k₂]."""
    v = np.linspace(-_REACH, _REACH, 20001)
    curve = _log_sum(v, rho, (4.0 - 3.0 * rho) / (3.0 - 2.0 * rho))
    return float(np.trapezoid(np.exp(v - curve), v))


def _log_sum(log_x: np.ndarray, low: float, high: float) -> np.ndarray:
    """log(x^low + x + x^high)."""
    return np.logaddexp(np.logaddexp(low * log_x, log_x), high * log_x)
