"""The options of `tune` and `check-gradients`; nothing here imports JAX."""

import argparse
from pathlib import Path
from typing import Any

from tuning.cli.options.arguments import (
    HELD_BY_DEFAULT,
    HELD_ON_REQUEST,
    add_case,
    add_common,
    add_controller,
    add_output,
    add_overwrite,
    at_least_four,
    below_one,
    count,
    not_negative,
    positive,
    seed,
    uncertainty,
    whole,
)


def add_tune(commands: Any) -> None:
    """`jaxglider tune`."""
    text = "tune gains by gradient descent through the rollout"
    parser = commands.add_parser("tune", help=text, description=text + ".")
    _add_task(parser)
    _add_ensemble(parser)
    _add_objective(parser)
    _add_descent(parser)
    parser.add_argument(
        "--no-check",
        action="store_true",
        help="do not check the gradient against differences, nor judge the gains at "
        "half and twice the tick and from other roundings",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on from the checkpoint in --out"
    )
    add_overwrite(parser)
    parser.add_argument(
        "--verbose",
        action="store_true",
        help="print every tuned number too, which gains.toml has",
    )
    add_common(parser, "results/tune")


def _add_descent(parser: argparse.ArgumentParser) -> None:
    descent = parser.add_argument_group("descent")
    descent.add_argument(
        "--method",
        choices=("gradient", "cma", "random"),
        default="gradient",
        help="cma and random are black-box searches on the same budget, a gradient "
        "counted as five rollouts; default: gradient",
    )
    descent.add_argument(
        "--population",
        type=at_least_four,
        metavar="N",
        help="draws per generation of cma and random, side by side; more for many "
        "cores or an accelerator; default: 4 + 3 log n, n the numbers tuned",
    )
    descent.add_argument(
        "--spread",
        type=positive,
        default=0.5,
        metavar="R",
        help="of the first draws of cma and random: standard deviation in the "
        "logarithm of a gain; default: 0.5",
    )
    descent.add_argument(
        "--steps", type=count, default=80, metavar="N", help="default: 80"
    )
    descent.add_argument(
        "--learning-rate",
        type=positive,
        default=0.05,
        metavar="R",
        help="of the first step, in the logarithm of a gain; it falls to zero along "
        "half a cosine; default: 0.05",
    )
    descent.add_argument(
        "--optimizer",
        default="adam",
        metavar="NAME",
        help="any of optax; default: adam",
    )
    descent.add_argument(
        "--patience",
        type=count,
        default=20,
        metavar="N",
        help="stop after so many steps without progress; default: 20",
    )
    descent.add_argument(
        "--gradient-memory",
        type=not_negative,
        default=150.0,
        metavar="S",
        help="how long the gradient remembers [s]; 0: for ever, the exact derivative, "
        "which may explode on long runs; default: 150",
    )
    descent.add_argument(
        "--starts",
        type=count,
        default=1,
        metavar="N",
        help="descents side by side, all but the first from scattered gains; "
        "default: 1",
    )
    descent.add_argument(
        "--seed",
        type=seed,
        default=0,
        metavar="N",
        help="of members and copies; default: 0",
    )


def add_check(commands: Any) -> None:
    """`jaxglider check-gradients`."""
    text = "say how far the gradient of each gain can be trusted"
    parser = commands.add_parser("check-gradients", help=text, description=text + ".")
    _add_task(parser)
    parser.add_argument(
        "--short",
        action="store_true",
        help="differences only; no comparison of horizons and smoothing widths",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write gradients.json and report.html there; nothing by default",
    )
    add_overwrite(parser)
    add_output(parser)


def _add_task(parser: argparse.ArgumentParser) -> None:
    add_case(parser)
    add_controller(parser)
    parser.add_argument(
        "--gains",
        metavar="FILE",
        help="start here, not at the paper's or the mission's gains; `tuned`: at those "
        "that come with jaxglider for this case",
    )
    parser.add_argument(
        "--free",
        nargs="+",
        default=[],
        metavar="PATH",
        help="what to tune: a name, as heading, for all whose path has it; dotted "
        "paths, `*` for any component, as controller.gains.*.k1 controller.steering "
        "observer.integral scenario.reference.line_of_sight; "
        "default: all of the controller and its observer",
    )
    parser.add_argument(
        "--unconstrained",
        nargs="*",
        choices=HELD_BY_DEFAULT,
        metavar="NAME",
        help="let go of these, of all where none is named: "
        f"{', '.join(HELD_BY_DEFAULT)} (each gain's own range is always held)",
    )
    parser.add_argument(
        "--constrain",
        nargs="+",
        choices=HELD_ON_REQUEST,
        default=[],
        metavar="NAME",
        help="hold these too: equal-edges, delta_L = delta_R; observer-set, for a "
        "disturbance whose rate --disturbance-rate bounds",
    )
    parser.add_argument(
        "--disturbance-rate",
        nargs=6,
        type=positive,
        metavar="R",
        help="bounds on the rate of the disturbance along surge, sway, heave [N/s] and "
        "about roll, pitch, yaw [N m/s]",
    )


def _add_ensemble(parser: argparse.ArgumentParser) -> None:
    ensemble = parser.add_argument_group("ensemble")
    ensemble.add_argument(
        "--members",
        type=count,
        default=32,
        metavar="N",
        help="gliders and seas to descend on; 1: the nominal case alone; default: 32",
    )
    ensemble.add_argument(
        "--validation",
        type=count,
        default=32,
        metavar="N",
        help="to choose by; default: 32",
    )
    ensemble.add_argument(
        "--test",
        type=count,
        default=64,
        metavar="N",
        help="held out for the verdict; default: 64",
    )
    ensemble.add_argument(
        "--uncertainty",
        type=uncertainty,
        default=0.2,
        metavar="H|FILE",
        help="relative half width of masses, inertias, coefficients and waves, or an "
        "uncertainty file (`jaxglider init --uncertainty` writes one); default: 0.2",
    )
    ensemble.add_argument(
        "--amplitude",
        type=below_one,
        metavar="H",
        help="relative half width of the waves' amplitudes, their phases free; "
        "default: that of --uncertainty",
    )
    ensemble.add_argument(
        "--position",
        type=not_negative,
        metavar="M",
        help="half width of the starting position [m]; default: 0",
    )
    ensemble.add_argument(
        "--adversarial",
        type=whole,
        default=0,
        metavar="ROUNDS",
        help="so many times after the descent, search for the worst members for the "
        "gains reached, tune on four of them too, and descend again; default: 0",
    )


def _add_objective(parser: argparse.ArgumentParser) -> None:
    objective = parser.add_argument_group("objective")
    objective.add_argument(
        "--aggregate",
        choices=("mean", "cvar", "worst"),
        help="how members' costs become one; default: mean",
    )
    objective.add_argument(
        "--objective",
        type=Path,
        metavar="FILE",
        help="TOML with [weights] (tracking, effort, chattering, crowding, roll, "
        "roll_limit_rad, saturation; a number, or a table of depth, pitch, heading) "
        "and [aggregate] (kind, share, sharpness)",
    )
    objective.add_argument(
        "--cost",
        metavar="FILE.py:NAME",
        help="your own cost instead: a function of the metrics of a run and of those "
        "at the start, positive there; a start whose members cost twice as much as its "
        "nominal case counts as lost",
    )
