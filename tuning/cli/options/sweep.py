"""The options of `sweep`, `merge` and `rerun`; nothing here imports JAX."""

import argparse
from pathlib import Path
from typing import Any

from tuning.campaign.analysis.requirements import requirement
from tuning.cli.options.arguments import (
    CONTROLLERS,
    OWN_LAW,
    add_case,
    checked,
    count,
    law,
    seed,
    share,
    uncertainty,
    whole,
)

DESIGNS = ("monte-carlo", "latin-hypercube", "sobol")


def add_sweep(commands: Any) -> None:
    """`jaxglider sweep`."""
    text = "say how sure gains are, from many gliders and seas drawn at random"
    parser = commands.add_parser("sweep", help=text, description=text + ".")
    _add_case(parser)
    _add_members(parser)
    _add_verdict(parser)
    _add_hosts(parser)
    parser.add_argument(
        "--precision", type=int, choices=(32, 64), default=32, help="default: 32"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results/sweep"),
        metavar="DIR",
        help="default: results/sweep",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the campaign in --out, or let it grow by more --members",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="discard the campaign in --out"
    )


def _add_verdict(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--confidence",
        type=share,
        default=0.95,
        metavar="C",
        help="of all intervals; default: 0.95",
    )
    parser.add_argument(
        "--require",
        nargs="+",
        type=requirement,
        default=[],
        metavar="RULE",
        help="as 'spec<0.05' (the whole specification; 'spec' alone means that), "
        "'p_violation<0.01' or 'heading.rms_error.q95<0.3', of all gains or, "
        "after a label and a colon, of one; exit code 3 unless the whole interval "
        "keeps each",
    )
    parser.add_argument(
        "--no-report", action="store_true", help="no report.md and no figures"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the summary as JSON on stdout"
    )


def _add_case(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--gains",
        nargs="+",
        metavar="FILE",
        help="gains files, as `tune` writes them, or the words paper, tuned and, with "
        "--config, mission; all meet the same members, and are compared with the "
        "first; default: mission with --config, else paper",
    )
    parser.add_argument(
        "--controller",
        nargs="+",
        type=law,
        metavar="NAME",
        help=f"what the words stand for, any of {', '.join(CONTROLLERS)}, or {OWN_LAW};"
        " default: fxtppc",
    )
    add_case(parser)


def _add_members(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--members", type=count, default=1000, metavar="N", help="default: 1000"
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="of the members; default: 0"
    )
    parser.add_argument(
        "--uncertainty",
        nargs="+",
        type=uncertainty,
        default=[0.2],
        metavar="H|FILE",
        help="relative half width of masses, inertias, coefficients and waves, or an "
        "uncertainty file; several levels are swept one after the other with the "
        "same draws; default: 0.2",
    )
    parser.add_argument(
        "--find-level",
        action="store_true",
        help="bisect for the level of uncertainty, up to --uncertainty, at which "
        "--require spec stops to hold; all levels share their draws, only wider",
    )
    parser.add_argument(
        "--sensitivity",
        type=count,
        default=0,
        metavar="N",
        help="say what is to blame, too: Sobol indices from N blocks (best a power of "
        "two, 128 or more) of as many runs as there are uncertain numbers and two, and "
        "gradients; default: rank correlations alone",
    )
    parser.add_argument(
        "--design",
        choices=DESIGNS,
        default="monte-carlo",
        help="how members are placed; intervals are exact for monte-carlo, usually too "
        "wide for the others; default: monte-carlo",
    )
    parser.add_argument(
        "--until-ci",
        type=share,
        metavar="W",
        help="stop as soon as the 95 %% interval of leaving a funnel is no wider than "
        "this for any gains; --members is then the most there can be",
    )
    parser.add_argument(
        "--shard",
        type=part,
        default=(1, 1),
        metavar="I/N",
        help="run the I-th of N parts only; `jaxglider merge` joins them",
    )


def _add_hosts(parser: argparse.ArgumentParser) -> None:
    hosts = parser.add_argument_group("several hosts")
    hosts.add_argument(
        "--coordinator",
        metavar="ADDRESS:PORT",
        help="of host 0; give every host the same command but for --host",
    )
    hosts.add_argument(
        "--hosts", type=count, default=1, metavar="N", help="how many there are"
    )
    hosts.add_argument(
        "--host", type=whole, default=0, metavar="I", help="number of this one, from 0"
    )


def part(text: str) -> tuple[int, int]:
    """One of several parts, as 2/4.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    words = text.split("/")
    try:
        number, parts = (int(word) for word in words)
    except ValueError:
        number, parts = 0, 0
    if not 1 <= number <= parts:
        raise argparse.ArgumentTypeError(
            f"must be I/N with 1 <= I <= N, as 2/4; received {text!r}."
        )
    return number, parts


def add_merge(commands: Any) -> None:
    """`jaxglider merge`."""
    text = "join the shards of a sweep"
    parser = commands.add_parser("merge", help=text, description=text + ".")
    parser.add_argument(
        "folders",
        nargs="+",
        type=Path,
        metavar="DIR",
        help="of the shards, in any order",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="for the whole campaign"
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="discard what is there"
    )
    _add_verdict(parser)


def add_rerun(commands: Any) -> None:
    """`jaxglider rerun`."""
    text = "run one member of a sweep again, with its trajectory and figures"
    parser = commands.add_parser("rerun", help=text, description=text + ".")
    parser.add_argument("folder", type=Path, metavar="DIR", help="of the sweep")
    parser.add_argument(
        "--member",
        type=_member,
        default="worst",
        metavar="I",
        help="its number, or worst or median (by the largest error over the edge of "
        "its funnel); default: worst",
    )
    parser.add_argument(
        "--gains",
        metavar="LABEL",
        help="whose worst or median member; default: the first of the sweep",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the metrics as JSON on stdout"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: member-I in the folder"
    )


def _member(text: str) -> int | str:
    if text in ("worst", "median"):
        return text
    rule = "a whole number of at least 0, worst or median"
    number: int = checked(text, int, lambda n: n >= 0, rule)
    return number
