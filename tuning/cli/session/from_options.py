"""Options of the command line turned into values: the only reader of a Namespace."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from jaxglider.core.toml import ConfigError, file_text, reason
from jaxglider.files.law_paths import is_same_law
from jaxglider.files.mission import load_mission, self_contained
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.signals import BodyAxes
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario
from jaxglider.uncertainty.members import Uncertainty
from jaxglider.uncertainty.quantities import uniform_uncertainty
from tuning.campaign.report.conclude import Conclusions
from tuning.campaign.run.campaign import CampaignSettings
from tuning.evaluation.beforehand import note_sense
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import MISSION, PAPER, TUNED
from tuning.problem.objective_file import load_cost, read_objective
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.console import note
from tuning.search.settings import BlackBoxSettings, DescentSettings
from tuning.space.coordinates import OBSERVER_SET, expand
from tuning.space.space import HELD_BY_DEFAULT

DEFAULT_CONTROLLER = "fxtppc"
"""Controller where neither option nor file names one."""


def flight_case(options: argparse.Namespace) -> FlightCase:
    """The case that a command is told: `--config`, or `--scenario` and `--plant`.

    Raises:
        ValueError: options that do not go together, or a file that cannot be used.
    """
    refuse_beside_mission(options)
    if options.config is not None:
        mission = load_mission(options.config)
        if mission.stand_ins:
            note(mission.stand_ins)
        return FlightCase.of_mission(mission, options.duration)
    scenario = options.scenario or "switching"
    plant = options.plant or "rigid-body"
    return FlightCase.of_paper(
        scenario, plant, options.dt, options.duration, options.actuators
    )


def note_mission(options: argparse.Namespace) -> None:
    """Say what in the mission of a command is hardly meant; nothing of a paper's case.

    To be called once all options are known to be right: what is wrong is said first.
    """
    if options.config is not None:
        mission = load_mission(options.config)
        case = FlightCase.of_mission(mission, options.duration)
        note_sense(mission, mission.law.on(case.scenario))


def refuse_beside_mission(options: argparse.Namespace) -> None:
    """Refuse options that say again what a mission file says.

    Raises:
        ValueError: names the option.
    """
    if options.config is None:
        return
    for name in ("scenario", "plant", "dt", "actuators"):
        if getattr(options, name, None) is not None:
            key = " as vehicle.plant" if name == "plant" else ""
            raise ValueError(
                f"--{name} does not go with a mission: the file {options.config} says "
                f"it itself{key}. Leave the option out."
            )


def problem_spec(options: argparse.Namespace) -> ProblemSpec:
    """The problem that `jaxglider tune` is told.

    Raises:
        ValueError: an option or a file cannot be used.
    """
    case = flight_case(options)
    controller, loop = starting_loop(options, case)
    weights, aggregate = read_objective(options.objective, options.aggregate)
    spec = ProblemSpec(
        case=case,
        controller=controller,
        loop=loop,
        free=tuple(options.free),
        ensemble=EnsembleSpec(
            uncertainty=_uncertainty(options, loop.scenario),
            training=options.members,
            validation=options.validation,
            test=options.test,
            seed=options.seed,
        ),
        weights=weights,
        cost=load_cost(options.cost) if options.cost else None,
        aggregate=aggregate,
        constraints=_constraints(options),
        disturbance_rate_bound=_rate_bound(options),
        gradient_memory=options.gradient_memory or None,
    )
    expand(loop, spec.paths)  # a word that names nothing is refused before all else
    return spec


def nominal_spec(options: argparse.Namespace) -> ProblemSpec:
    """The problem that `jaxglider check-gradients` is told: the nominal case alone.

    Raises:
        ValueError: an option or a file cannot be used.
    """
    case = flight_case(options)
    controller, loop = starting_loop(options, case)
    spec = ProblemSpec(
        case=case,
        controller=controller,
        loop=loop,
        free=tuple(options.free),
        ensemble=EnsembleSpec.nominal(),
        constraints=_constraints(options),
        disturbance_rate_bound=_rate_bound(options),
        gradient_memory=None,
    )
    expand(loop, spec.paths)
    return spec


def starting_loop(
    options: argparse.Namespace, case: FlightCase
) -> tuple[str, ClosedLoop]:
    """The name of the control law and the closed loop to start from.

    Raises:
        ValueError: the gains are for another law than asked for.
    """
    wanted = options.controller
    words = [PAPER] if case.own is None else [MISSION, PAPER]
    if options.gains is not None:
        words = [str(options.gains)]
    for word in words:
        (gains,) = case.resolve([word], [wanted or DEFAULT_CONTROLLER])
        controller, loop = case.loop(gains)
        if wanted is None or is_same_law(wanted, controller):
            return controller, loop
    raise ValueError(
        f"--controller is {wanted}, but {options.gains} holds {controller}."
    )


def descent_settings(options: argparse.Namespace) -> DescentSettings:
    """Settings of the descent of `jaxglider tune`.

    Raises:
        ValueError: a number is out of its range, or the optimiser is unknown.
    """
    return DescentSettings(
        steps=options.steps,
        learning_rate=options.learning_rate,
        optimiser=options.optimizer,
        patience=options.patience,
        starts=options.starts,
        seed=options.seed,
    )


def black_box_settings(options: argparse.Namespace) -> BlackBoxSettings | None:
    """Settings of a search without gradients; None for a descent."""
    if options.method == "gradient":
        return None
    return BlackBoxSettings(options.method, options.population, options.spread)


def campaign_settings(
    options: argparse.Namespace, half_width: float | Path
) -> CampaignSettings:
    """The settings of one campaign of `jaxglider sweep`.

    Args:
        options: options of the command.
        half_width: one of the levels of uncertainty asked for: a number or a file.

    Raises:
        ValueError: a file cannot be read.
    """
    case = flight_case(options)
    words = gains_words(options)
    return CampaignSettings(
        scenario=case.title,
        plant=case.plant,
        dt=options.dt,
        duration=options.duration,
        actuators=options.actuators,
        precision=options.precision,
        seed=options.seed,
        members=options.members,
        design=options.design,
        uncertainty=_text(half_width),
        gains=case.resolve(words, options.controller or [DEFAULT_CONTROLLER]),
        until_ci=options.until_ci,
        mission=None if options.config is None else self_contained(options.config),
    )


def gains_words(options: argparse.Namespace) -> list[str]:
    """The words and files that `jaxglider sweep` is to take gains from."""
    words: list[str] = options.gains or [PAPER if options.config is None else MISSION]
    return words


def note_needless_controller(
    words: Sequence[str], controller: str | Sequence[str] | None
) -> None:
    """Say that `--controller` changes nothing where no gains ask for it.

    Args:
        words: words and files that gains are taken from.
        controller: law or laws that were asked for, or None.
    """
    if controller and not {PAPER, TUNED} & set(words):
        note(
            f"--controller is not used: it goes with the words {PAPER} and {TUNED}; "
            "gains files and missions say their own law."
        )


def conclusions(options: argparse.Namespace) -> Conclusions:
    """Choice of the conclusions that `jaxglider sweep` and `merge` draw."""
    return Conclusions(
        confidence=options.confidence,
        requirements=tuple(options.require),
        sensitivity=getattr(options, "sensitivity", 0),
        report=not options.no_report,
    )


def _constraints(options: argparse.Namespace) -> tuple[str, ...]:
    """Those held by default but for `--unconstrained`, and those of `--constrain`."""
    free = options.unconstrained
    if free is None:
        free = ()
    elif not free:
        free = HELD_BY_DEFAULT
    return (*(x for x in HELD_BY_DEFAULT if x not in free), *options.constrain)


def _rate_bound(options: argparse.Namespace) -> BodyAxes[float] | None:
    """`--disturbance-rate` by axis."""
    rates = options.disturbance_rate
    if (rates is None) == (OBSERVER_SET in options.constrain):
        raise ValueError(
            f"--constrain {OBSERVER_SET} and --disturbance-rate go together: the set "
            "is that of a disturbance whose rate is bounded."
        )
    return None if rates is None else BodyAxes(*rates)


def _uncertainty(options: argparse.Namespace, scenario: Scenario) -> Uncertainty:
    """The members' uncertainty: one half width for all, or the content of a file."""
    if isinstance(options.uncertainty, Path):
        if options.amplitude is not None or options.position is not None:
            raise ValueError(
                "--amplitude and --position go with a number for --uncertainty; "
                f"{options.uncertainty} says itself how far waves and starts differ."
            )
        return load_uncertainty(options.uncertainty, scenario)
    half = options.uncertainty
    return uniform_uncertainty(
        scenario,
        half,
        half if options.amplitude is None else options.amplitude,
        options.position or 0.0,
    )


def _text(half_width: float | Path) -> float | str:
    if isinstance(half_width, float):
        return half_width
    try:
        return file_text(half_width)
    except OSError as error:
        raise ConfigError(f"{half_width}: cannot be read ({reason(error)}).") from error
