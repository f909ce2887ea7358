"""Elementwise primitives of JAX in C, scalar by scalar.

Integers wrap as in XLA, by way of unsigned arithmetic; shifts to the right of signed
numbers are taken to be arithmetic, as every compiler in use has them. NaN goes through
minimum, maximum and clamp as it does in XLA.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxglider.export.c.block import C_TYPES, Block, ExportError, Number, literal

_LIBRARY = {
    "abs": "fabs",
    "acos": "acos",
    "acosh": "acosh",
    "asin": "asin",
    "asinh": "asinh",
    "atan": "atan",
    "atan2": "atan2",
    "atanh": "atanh",
    "cbrt": "cbrt",
    "ceil": "ceil",
    "cos": "cos",
    "cosh": "cosh",
    "erf": "erf",
    "exp": "exp",
    "exp2": "exp2",
    "expm1": "expm1",
    "floor": "floor",
    "log": "log",
    "log1p": "log1p",
    "nextafter": "nextafter",
    "pow": "pow",
    "rem": "fmod",
    "sin": "sin",
    "sinh": "sinh",
    "sqrt": "sqrt",
    "tan": "tan",
    "tanh": "tanh",
}
_COMPARISONS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_REAL = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_HELPERS = {"max": "real_max", "min": "real_min", "sign": "real_sign"}
_BITWISE = {"and": "&", "or": "|", "xor": "^"}
_LOGICAL = {"and": "&&", "or": "||", "xor": "!="}
_SAME = ("copy", "copy_p", "stop_gradient")

Rule = Callable[[Block, Sequence[Number], str, dict[str, Any]], Number]


def apply(
    block: Block, name: str, operands: Sequence[Number], kind: str, params: Any
) -> Number:
    """One primitive on scalars.

    Args:
        block: block that takes the statements.
        name: name of the primitive.
        operands: scalars of its operands.
        kind: kind of the result.
        params: parameters of the primitive.

    Raises:
        ExportError: the primitive has no form in C here.
    """
    first = operands[0].kind
    if name in _SAME:
        return operands[0]
    if name in _RULES:
        return _RULES[name](block, operands, kind, params)
    text = _expression(name, [x.text for x in operands], first)
    if text is None:
        raise ExportError(unsupported(name, f" of {first}"))
    return block.compute(kind, text, operands, name)


def unsupported(name: str, what: str = "") -> str:
    """The message for a primitive that is not covered."""
    return (
        f"the primitive {name!r}{what} cannot be exported; covered are "
        f"{', '.join(sorted(covered()))}. Write the formula with those."
    )


def covered() -> set[str]:
    """Names of the elementwise primitives that have a form in C."""
    names = {*_LIBRARY, *_COMPARISONS, *_REAL, *_HELPERS, *_BITWISE, *_RULES, *_SAME}
    return names | {"neg", "not"}


def _expression(name: str, x: list[str], kind: str) -> str | None:
    """The C expression, or None where there is none."""
    if name in _COMPARISONS:
        return f"{x[0]} {_COMPARISONS[name]} {x[1]}"
    if kind == "bool":
        if name in _LOGICAL:
            return f"{x[0]} {_LOGICAL[name]} {x[1]}"
        return f"!{x[0]}" if name == "not" else None
    if kind == "real":
        if name in _REAL:
            return f"{x[0]} {_REAL[name]} {x[1]}"
        if name == "neg":
            return f"-{x[0]}"
        function = _HELPERS.get(name) or (
            f"real_{_LIBRARY[name]}" if name in _LIBRARY else None
        )
        return f"{function}({', '.join(x)})" if function else None
    return _whole(name, x, kind)


def _whole(name: str, x: list[str], kind: str) -> str | None:
    signed = C_TYPES[kind]
    unsigned = signed if kind.startswith("u") else f"u{signed}"
    if name in ("add", "sub", "mul"):
        return f"({signed})(({unsigned}){x[0]} {_REAL[name]} ({unsigned}){x[1]})"
    if name == "neg":
        return f"({signed})(0u - ({unsigned}){x[0]})"
    if name in _BITWISE:
        return f"{x[0]} {_BITWISE[name]} {x[1]}"
    if name == "not":
        return f"~{x[0]}"
    if name in ("max", "min"):
        return f"{x[0]} {'>' if name == 'max' else '<'} {x[1]} ? {x[0]} : {x[1]}"
    if name in ("sign", "abs") and not kind.startswith("u"):
        return (
            f"{x[0]} > 0 ? 1 : {x[0]} < 0 ? -1 : 0"
            if name == "sign"
            else f"{x[0]} < 0 ? ({signed})(0u - ({unsigned}){x[0]}) : {x[0]}"
        )
    return None


def _select(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    which, *cases = x
    if which.value is not None:
        return cases[int(which.value)]
    if all(c.text == cases[0].text for c in cases):
        return cases[0]
    if which.kind == "bool":
        return block.compute(
            kind, f"{which.text} ? {cases[1].text} : {cases[0].text}", x, "select"
        )
    text = cases[-1].text
    for n in range(len(cases) - 2, -1, -1):
        text = f"{which.text} == {n} ? {cases[n].text} : {text}"
    return block.compute(kind, text, x, "select")


def _convert(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    (a,) = x
    if a.kind == kind:
        return a
    if a.value is not None:
        return literal(a.value, kind)
    if kind == "bool":
        text = f"{a.text} != 0"
    elif a.kind == "bool":
        text = f"{a.text} ? {literal(1, kind).text} : {literal(0, kind).text}"
    elif a.kind == "real":
        if kind != "int32":
            raise ExportError(unsupported("convert_element_type", f" to {kind}"))
        text = f"real_to_int32({a.text})"
    else:
        text = f"({C_TYPES[kind]}){a.text}"
    return block.compute(kind, text, x, "convert")


def _clamp(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    low, value, high = x
    raised = apply(block, "max", (value, low), kind, params)
    return apply(block, "min", (raised, high), kind, params)


def _integer_pow(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    """By squaring, as XLA does it."""
    base, exponent = x[0], abs(params["y"])
    power: Number | None = None
    while exponent:
        if exponent & 1:
            power = (
                base if power is None else apply(block, "mul", (power, base), kind, {})
            )
        exponent >>= 1
        if exponent:
            base = apply(block, "mul", (base, base), kind, {})
    one = literal(1, kind)
    if power is None:
        return one
    return power if params["y"] > 0 else apply(block, "div", (one, power), kind, {})


def _square(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    return apply(block, "mul", (x[0], x[0]), kind, params)


def _rsqrt(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    root = apply(block, "sqrt", x, kind, params)
    return apply(block, "div", (literal(1, kind), root), kind, params)


def _logistic(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    one = literal(1, kind)
    fall = apply(block, "exp", (apply(block, "neg", x, kind, {}),), kind, {})
    below = apply(block, "add", (one, fall), kind, {})
    return apply(block, "div", (one, below), kind, {})


def _sum_of_slopes(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    """The sum of derivatives, which has a primitive of its own."""
    return apply(block, "add", x, kind, {})


def _is_finite(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    return block.compute(kind, f"isfinite({x[0].text}) != 0", x, "is_finite")


def _round(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    # 0 rounds halves away from zero, 1 to the nearest even number.
    function = "real_rint" if int(params["rounding_method"]) else "real_round"
    return block.compute(kind, f"{function}({x[0].text})", x, "round")


def _total_order(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    """Less than, with NaN above everything."""
    a, b = x[0].text, x[1].text
    text = f"{a} < {b} || ({b} != {b} && {a} == {a})"
    return block.compute(kind, text, x, "lt")


def _divide(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    if kind == "real":
        return block.compute(kind, f"{x[0].text} / {x[1].text}", x, "div")
    if x[1].value is None or int(x[1].value) < 1:
        raise ExportError(unsupported("div", " of whole numbers by a variable"))
    return block.compute(kind, f"{x[0].text} / {x[1].text}", x, "div")


def _remainder(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    if kind == "real":
        return block.compute(kind, f"real_fmod({x[0].text}, {x[1].text})", x, "rem")
    if x[1].value is None or int(x[1].value) < 1:
        raise ExportError(unsupported("rem", " of whole numbers by a variable"))
    return block.compute(kind, f"{x[0].text} % {x[1].text}", x, "rem")


def _shift(operator: str, *, logical: bool = False) -> Rule:
    def rule(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
        if x[1].value is None or not 0 <= int(x[1].value) < np.dtype(kind).itemsize * 8:
            raise ExportError(unsupported("shift", " by a variable"))
        plain = C_TYPES[kind]
        bits = int(x[1].value)
        if logical or operator == "<<":
            unsigned = plain if kind.startswith("u") else f"u{plain}"
            text = f"({plain})(({unsigned}){x[0].text} {operator} {bits})"
        else:
            text = f"{x[0].text} {operator} {bits}"
        return block.compute(kind, text, x, "shift")

    return rule


def _bits(block: Block, x: Sequence[Number], kind: str, params: Any) -> Number:
    if x[0].kind == kind:
        return x[0]
    if not block.of_one_precision:
        raise ExportError(
            unsupported("bitcast_convert_type", ", which depends on the precision,")
        )
    function = "real_from_bits" if kind == "real" else "real_to_bits"
    return block.compute(kind, f"{function}({x[0].text})", x, "bits")


_RULES: dict[str, Rule] = {
    "add_any": _sum_of_slopes,
    "bitcast_convert_type": _bits,
    "clamp": _clamp,
    "convert_element_type": _convert,
    "div": _divide,
    "integer_pow": _integer_pow,
    "is_finite": _is_finite,
    "logistic": _logistic,
    "lt_to": _total_order,
    "rem": _remainder,
    "round": _round,
    "rsqrt": _rsqrt,
    "select_n": _select,
    "shift_left": _shift("<<"),
    "shift_right_arithmetic": _shift(">>"),
    "shift_right_logical": _shift(">>", logical=True),
    "square": _square,
}
