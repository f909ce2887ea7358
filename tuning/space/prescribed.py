"""Prescribed performance by construction: funnels and gains inside a specification.

Whatever the free numbers are,

- `inside-specification`: P(t*) ≤ P_spec(t*) for all t*, δ_L ≤ δ_L,spec, δ_R ≤ δ_R,spec,
  so that an error inside the law's own funnel is inside what is specified. The box of
  P₀, P_∞ and T is that of `bounds_of_a_funnel_inside`, where the proof is.
- `restart-inside`: δ P(0) is at least the jump of the reference at a restart, so that
  an error which was zero before it is inside after it; with `inside-specification`.
- `surface-settles`: 2π/(3√3) μ/(k₁ + k₂), the exact bound on the settling of the
  surface s, is at most the required settling time.
- `error-settles`: with Tian's pairing of the exponents, a bound on the settling of the
  error on s = 0 as well; with `surface-settles`.
- `equal-edges`: δ_L = δ_R, port and starboard alike; only on request.
"""

from collections.abc import Collection, Iterator
from operator import attrgetter

from jaxglider.control.fxtppc import ChannelGains, tian_exponents
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.core.sets import K1_BELOW_K2
from jaxglider.signals import CHANNELS
from jaxglider.simulation.checks.start import restart_jumps
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.space.coordinate import Coordinate
from tuning.space.error_settling import ERROR, error_coordinates
from tuning.space.funnel_box import INSIDE, RESTART, FunnelBox
from tuning.space.settling import SURFACE, settling

EQUAL_EDGES = "equal-edges"
PRESCRIBED = (INSIDE, RESTART, SURFACE, ERROR)
"""Names of the constraints that a specification asks for."""


def prescribed(
    loop: ClosedLoop, names: Collection[str], constraints: Collection[str]
) -> tuple[dict[str, Coordinate], list[str]]:
    """Coordinates that keep what is specified, by path, and remarks on the rest.

    Args:
        loop: closed loop that the search starts from, with concrete numbers.
        names: paths of the tuned numbers.
        constraints: names of the constraints to hold.
    """
    specification = loop.scenario.specification
    held: dict[str, Coordinate] = {}
    notes: list[str] = []
    if specification is None:
        return held, notes
    jumps = restart_jumps(loop.scenario) if RESTART in constraints else None
    for base, channel in _owners(names, "performance"):
        if INSIDE in constraints and isinstance(attrgetter(base)(loop), Funnel):
            jump = 0.0 if jumps is None else getattr(jumps, channel)
            box = FunnelBox(loop, base, channel, specification, names, jump)
            held.update(box.coordinates())
            notes += box.notes
    if SURFACE in constraints:
        times = specification.required_settling()
        for path in _channel_gains(loop, names):
            time = getattr(times, path.rpartition(".")[2])
            if time is not None:
                new, words = settling(
                    loop, path, float(time), names, K1_BELOW_K2 in constraints
                )
                held.update(new)
                notes += words
                if ERROR in constraints and _is_tian(loop, path):
                    new, words = error_coordinates(loop, path, float(time), names)
                    held.update(new)
                    notes += words
    return held, notes


def _is_tian(loop: ClosedLoop, owner: str) -> bool:
    """Whether the law that has some gains pairs its exponents as Tian does."""
    law = attrgetter(owner.rpartition(".gains.")[0])(loop)
    return getattr(law, "exponents", None) is tian_exponents


def _owners(names: Collection[str], field: str) -> Iterator[tuple[str, str]]:
    """Paths of objects with a field of channels below which something is tuned."""
    found: dict[tuple[str, str], None] = {}
    for name in names:
        parts = name.split(".")
        for at, part in enumerate(parts[:-2]):
            if part in (field, "transformation") and parts[at + 1] in CHANNELS:
                found[".".join(parts[:at]), parts[at + 1]] = None
    yield from found


def _channel_gains(loop: ClosedLoop, names: Collection[str]) -> Iterator[str]:
    """Paths of the gains k₁, k₂, ρ, μ of a channel of which one is tuned."""
    for owner in dict.fromkeys(name.rpartition(".")[0] for name in names):
        channel = owner.rpartition(".")[2]
        if channel in CHANNELS and isinstance(attrgetter(owner)(loop), ChannelGains):
            yield owner
