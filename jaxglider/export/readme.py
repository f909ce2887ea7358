"""The README.md of an export."""

from jaxglider.export.autopilot import TEMPLATES
from jaxglider.export.columns import FLOAT_ALLOWANCES
from jaxglider.export.cost import MEGAHERTZ, Cost
from jaxglider.onboard.guard import BITS, STATUS
from jaxglider.onboard.of_loop import Pilot
from jaxglider.onboard.sensed import SensedAutopilot


def readme_text(
    title: str,
    about: str,
    pilot: Pilot,
    cost: Cost,
    rows: dict[str, int],
    hold: int,
) -> str:
    """The text.

    Args:
        title: name of the exported controller.
        about: sentence about program and date.
        pilot: autopilot that is exported.
        cost: cost of a tick.
        rows: number of compared rows of each file of vectors, by name.
        hold: ticks of a row of the closed loop.
    """
    dt, sensed = float(pilot.dt), isinstance(pilot, SensedAutopilot)
    inputs = _template("told_samples.md" if sensed else "told_state.md")
    inputs = inputs.replace("{dt:g}", f"{dt:g}")
    if isinstance(pilot, SensedAutopilot):
        inputs = inputs.replace("{patience:g}", f"{float(pilot.patience):g}")
    bits = [
        f"| {bit} | `GLIDER_{n.upper()}` | {STATUS[n]} |" for n, bit in BITS.items()
    ]
    operations = [f"| {kind} | {count} |" for kind, count in cost.operations.items()]
    return _template("README.md").format(
        title=title,
        about=about,
        inputs=inputs,
        in_the_loop="" if sensed else "\n" + _template("in_the_loop.md"),
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


def _template(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")
