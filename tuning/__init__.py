"""Tuning of controller gains through the rollout: the Python API and the command line.

What is named here is loaded when it is first used: the command line answers `--help`
without JAX.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuning.api.check_gradients import GradientCheck as GradientCheck
    from tuning.api.check_gradients import check_gradients as check_gradients
    from tuning.api.fit import FitResult as FitResult
    from tuning.api.fit import fit as fit
    from tuning.api.results import SweepResult as SweepResult
    from tuning.api.results import TuneResult as TuneResult
    from tuning.api.sweep import sweep as sweep
    from tuning.api.tune import tune as tune
    from tuning.api.worst import WorstResult as WorstResult
    from tuning.api.worst import worst as worst
    from tuning.problem.aggregates import CVaR as CVaR
    from tuning.problem.aggregates import Mean as Mean
    from tuning.problem.aggregates import SoftWorst as SoftWorst
    from tuning.problem.objective import Weights as Weights
    from tuning.search.settings import BlackBoxSettings as BlackBoxSettings
    from tuning.search.settings import DescentSettings as DescentSettings

_PLACES = {
    "BlackBoxSettings": "tuning.search.settings",
    "CVaR": "tuning.problem.aggregates",
    "DescentSettings": "tuning.search.settings",
    "FitResult": "tuning.api.fit",
    "GradientCheck": "tuning.api.check_gradients",
    "Mean": "tuning.problem.aggregates",
    "SoftWorst": "tuning.problem.aggregates",
    "SweepResult": "tuning.api.results",
    "TuneResult": "tuning.api.results",
    "Weights": "tuning.problem.objective",
    "WorstResult": "tuning.api.worst",
    "check_gradients": "tuning.api.check_gradients",
    "fit": "tuning.api.fit",
    "sweep": "tuning.api.sweep",
    "tune": "tuning.api.tune",
    "worst": "tuning.api.worst",
}
__all__ = tuple(_PLACES)


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(importlib.import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'tuning' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
