"""Cost of a tick of the exported code: operations, bytes, and an estimate of time.

Operations are counted in the statements that depend on state or inputs; what depends on
gains alone is folded by the compiler. Times on a microcontroller are not measured: they
are counts times cycles, with these cycles assumed.

| operation | single precision in hardware | double precision in software |
|---|---:|---:|
| addition, subtraction, sign | 1 | 65 |
| multiplication | 1 | 65 |
| division, square root | 14 | 250 |
| function of the C library | 100 | 1500 |
| comparison, selection, minimum, floor | 3 | 30 |
| integers, logic, bits | 1 | 1 |
| loading and storing, for each of the above | 4 | 8 |

The first column is a Cortex-M4F, whose manual gives 1 and 14; the rest, and the second
column (a core without a unit for doubles), are round numbers for common libraries. Take
the result as right to a factor of two.
"""

import dataclasses
from collections import Counter
from collections.abc import Iterable

from jaxglider.export.autopilot import Source
from jaxglider.export.c.block import Statement

_CLASSES = {
    "additions": ("add", "sub", "neg", "abs"),
    "multiplications": ("mul",),
    "divisions and roots": ("div", "sqrt", "rem"),
    "comparisons and selections": (
        *("select", "max", "min", "sign", "floor", "ceil", "round", "clamp"),
        *("eq", "ne", "lt", "le", "gt", "ge", "is_finite"),
    ),
    "logic and integers": (
        *("and", "or", "xor", "not", "convert", "shift", "bits", "look_up", "table"),
    ),
}
_PRODUCT = ("additions", "multiplications")
_CYCLES = {
    "additions": (1, 65),
    "multiplications": (1, 65),
    "divisions and roots": (14, 250),
    "comparisons and selections": (3, 30),
    "logic and integers": (1, 1),
    "library functions": (100, 1500),
}
_MEMORY = (4, 8)
MEGAHERTZ = 100.0


@dataclasses.dataclass(frozen=True)
class Cost:
    """Cost of one tick, plan and step together.

    Attributes:
        operations: number of operations of each kind.
        state_bytes: bytes of the state in single and double precision.
        constant_bytes: bytes of gains and other constants in single and double
            precision.
        microseconds: time estimated at 100 MHz in single and double precision; see the
            module's text.
    """

    operations: dict[str, int]
    state_bytes: tuple[int, int]
    constant_bytes: tuple[int, int]
    microseconds: tuple[float, float]


def cost_of(source: Source) -> Cost:
    """Count what one tick of an exported autopilot takes."""
    inside = {
        f.name: f.block.needed(f.results) for f in source.shared.outlined.values()
    }
    inside |= {
        double.name: double.block.needed(double.results)
        for double, _ in source.shared.elementary.values()
    }
    counts: Counter[str] = Counter()
    for name in ("glider_plan", "glider_step"):
        counts += _counted(source.functions[name].statements, inside)
    cycles = [
        sum(n * (_CYCLES[kind][at] + _MEMORY[at]) for kind, n in counts.items())
        for at in (0, 1)
    ]
    structures = source.structures

    def size(name: str) -> tuple[int, int]:
        return structures[name].size(4), structures[name].size(8)

    return Cost(
        operations={kind: counts[kind] for kind in _CYCLES},
        state_bytes=size("state"),
        constant_bytes=size("parameters"),
        microseconds=(cycles[0] / MEGAHERTZ, cycles[1] / MEGAHERTZ),
    )


def _counted(
    statements: Iterable[Statement], inside: dict[str, list[Statement]]
) -> Counter[str]:
    counts: Counter[str] = Counter()
    for statement in statements:
        if not statement.varies or statement.operation == "load":
            continue
        kind, *rest = statement.operation.split(" ")
        if kind == "call":
            counts += _counted(inside[rest[0]], inside)
        elif kind == "product":
            counts += Counter(dict.fromkeys(_PRODUCT, int(rest[0])))
        elif kind == "loop":
            once = _counted(inside[rest[1]], inside)
            counts += Counter({k: int(rest[0]) * n for k, n in once.items()})
        else:
            counts[_class_of(kind)] += 1
    return counts


def _class_of(operation: str) -> str:
    for name, members in _CLASSES.items():
        if operation in members:
            return name
    return "library functions"
