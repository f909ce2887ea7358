"""The README.md of an export."""

from jaxglider.export.autopilot import TEMPLATES
from jaxglider.export.columns import FLOAT_ALLOWANCES
from jaxglider.export.cost import MEGAHERTZ, Cost
from jaxglider.onboard.guard import BITS, STATUS


def readme_text(
    title: str, about: str, dt: float, cost: Cost, rows: dict[str, int], hold: int
) -> str:
    """The text.

    Args:
        title: name of the exported controller.
        about: sentence about program and date.
        dt: control tick [s].
        cost: cost of a tick.
        rows: number of compared rows of each file of vectors, by name.
        hold: ticks of a row of the closed loop.
    """
    bits = [
        f"| {bit} | `GLIDER_{n.upper()}` | {STATUS[n]} |" for n, bit in BITS.items()
    ]
    operations = [f"| {kind} | {count} |" for kind, count in cost.operations.items()]
    return (
        (TEMPLATES / "README.md")
        .read_text(encoding="utf-8")
        .format(
            title=title,
            about=about,
            dt=dt,
            vectors=rows["VECTORS_DOUBLE"],
            faults=rows["FAULTS_DOUBLE"],
            closed=hold * rows["CLOSED_LOOP_DOUBLE"],
            command_float=FLOAT_ALLOWANCES["COMMAND_FLOAT"],
            state_float=FLOAT_ALLOWANCES["STATE_FLOAT"],
            bits="\n".join(bits),
            total=sum(cost.operations.values()),
            operations="\n".join(operations),
            state=cost.state_bytes,
            constants=cost.constant_bytes,
            megahertz=MEGAHERTZ,
            time=[us / 1e3 for us in cost.microseconds],
            share=[us / 1e6 / dt * 100 for us in cost.microseconds],
        )
    )
