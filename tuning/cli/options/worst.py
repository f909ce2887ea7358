"""The options of `worst`; nothing here imports JAX."""

from typing import Any

from tuning.cli.options.arguments import (
    add_case,
    add_common,
    add_controller,
    add_overwrite,
    count,
    seed,
    uncertainty,
    whole,
)


def add_worst(commands: Any) -> None:
    """`jaxglider worst`."""
    text = "search what is uncertain for the member that violates most"
    parser = commands.add_parser("worst", help=text, description=text + ".")
    add_case(parser)
    add_controller(parser)
    parser.add_argument(
        "--gains",
        metavar="FILE",
        help="gains to attack, as for `tune`; default: the mission's, else paper",
    )
    parser.add_argument(
        "--uncertainty",
        type=uncertainty,
        default=0.2,
        metavar="H|FILE",
        help="box to search: relative half width of masses, inertias, coefficients and "
        "waves, or an uncertainty file; default: 0.2",
    )
    parser.add_argument(
        "--budget",
        type=count,
        default=200,
        metavar="N",
        help="rollouts of the search, a gradient counted as five; default: 200",
    )
    parser.add_argument(
        "--random",
        type=whole,
        default=2000,
        metavar="N",
        help="random members to compare with; 0: none; default: 2000",
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="of all draws; default: 0"
    )
    add_overwrite(parser)
    add_common(parser, "results/worst")
