"""Every primitive in C against the same function in JAX, and refusals by name."""

import ctypes

import compiled_c
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_c import compile_library, numbers, structure
from jax import lax

from jaxglider.control.observer import observer_root
from jaxglider.control.prescribed.performance import SechFunction
from jaxglider.core.elementary import arctan, exp2, log2, sincos
from jaxglider.core.numerics import select
from jaxglider.core.rotations import attitude
from jaxglider.export.c.block import Block, ExportError
from jaxglider.export.c.fields import fields_of
from jaxglider.export.c.outlined import Functions
from jaxglider.export.c.source import (
    Argument,
    Structure,
    constants_text,
    helper_text,
    write_function,
)
from jaxglider.paper.cases import vertical_schedule
from jaxglider.signals import Channels

needs_compiler = pytest.mark.skipif(
    compiled_c.COMPILER is None, reason="no C compiler on this machine"
)

WILD = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -2.5,
    3.7,
    1e-9,
    700.0,
    -1e4,
    np.inf,
    -np.inf,
    np.nan,
]
EXAMPLE = {
    "x": jnp.zeros(()),
    "y": jnp.zeros(()),
    "k": jnp.zeros((), jnp.int32),
    "m": jnp.zeros((), jnp.int32),
    "b": jnp.zeros((), bool),
}
TABLE = jnp.asarray([2.0, 3.0, 5.0, 7.0, 11.0])
LONG = jnp.arange(40.0) ** 2
GRID = jnp.arange(12.0).reshape(3, 4)


def compiled(folder, function, parameters=None):
    """The function of EXAMPLE in C: takes a dictionary, returns a flat list."""
    parameters = {"p": jnp.asarray(0.3)} if parameters is None else parameters
    example = jax.eval_shape(function, parameters, EXAMPLE)
    given = Structure("given", "In.", EXAMPLE)
    result = Structure("result", "Out.", example)
    shared = Functions()
    written = write_function(
        "compute",
        "It.",
        lambda p, g: (function(p, g),),
        ("constants", parameters),
        [Argument("in", given), Argument("out", result, reads=False, writes=True)],
        shared,
    )
    held = Structure("held", "Constants.", parameters).declaration()
    text = (
        '#include "glider_real.h"\n'
        f"{given.declaration()}{result.declaration()}{held}"
        f"static {constants_text('held', 'constants', parameters)}"
        f"{helper_text(shared)}{written.prototype};\n{written.text}"
    )
    code = compile_library(folder, {"code.c": text})
    kinds = structure(given), structure(result)

    def call(**values):
        out = kinds[1]()
        code.compute(ctypes.byref(kinds[0](**values)), ctypes.byref(out))
        return numbers(out)

    return call


def agree(call, function, cases, rtol=1e-14):
    """C and JAX give the same for every case."""
    run = jax.jit(lambda g: function({"p": jnp.asarray(0.3)}, g))
    for case in cases:
        typed = {k: jnp.asarray(v, EXAMPLE[k].dtype) for k, v in case.items()}
        expected = np.concatenate(
            [np.ravel(np.asarray(v, float)) for v in jax.tree.leaves(run(typed))]
        )
        np.testing.assert_allclose(call(**case), expected, rtol, atol=1e-300)


def cases(values=WILD):
    draw = np.random.default_rng(0)
    for x in values:
        for y in values:
            k, m = (int(n) for n in draw.integers(-3, 7, 2))
            yield {"x": x, "y": y, "k": k, "m": m, "b": bool(draw.integers(2))}


def everything(p, g):
    """The elementwise primitives, on wild numbers."""
    x, y, k, m, b = (g[n] for n in "xykmb")
    return [
        *(x + y, x - y, x * y, x / y, -x, abs(x), x * x, x**3, x**-2, p["p"] * x),
        *(jnp.maximum(x, y), jnp.minimum(x, y), jnp.clip(x, -1.0, 1.0), jnp.sign(x)),
        *(jnp.floor(x), jnp.ceil(x), jnp.round(x), lax.rem(x, y)),
        *(x == y, x != y, x < y, x <= y, x > y, x >= y, jnp.isfinite(x)),
        *(jnp.isnan(x), b & (x > y), b | (x > y), b ^ (x > y), ~b),
        *(jnp.where(b, x, y), jnp.where(x > y, k, m), lax.select_n(b, x, y)),
        *(k + m, k - m, k * m, -k, abs(k), jnp.maximum(k, m), jnp.minimum(k, m)),
        *(k == m, k < m, k & m, k | m, k ^ m, ~k, k << 2, k >> 1, jnp.sign(k)),
        *(lax.shift_right_logical(k, jnp.int32(1)), lax.div(k, jnp.int32(2))),
        *(k.astype(float), x.astype(bool), b.astype(float), b.astype(jnp.int32)),
        *(jnp.nan_to_num(x).astype(jnp.int32), k.astype(bool)),
        lax.switch(k, [lambda: x, lambda: y, lambda: x * 2.0]),
        *(select(k, TABLE), select(7 * k, LONG), (LONG * x)[k]),
        *(
            LONG[k],
            LONG.at[9 * k].get(mode="fill"),
            lax.dynamic_slice(LONG, (k,), (2,)),
        ),
        TABLE[k],
        TABLE.at[k].get(mode="fill"),
        lax.dynamic_slice(GRID, (k, m), (2, 2)),
    ]


def _root(b):
    gains = (jnp.full_like(b, value) for value in (0.1, 0.01, 2.0, 1e-3))
    return observer_root(b, tuple(gains), 4)


def smooth(p, g):
    """Functions of the C library and of `elementary`, on tame numbers."""
    x, y, k = g["x"], g["y"], g["k"]
    u = jnp.tanh(x)
    vector = jnp.stack([x, y, x * y])
    return [
        *(jnp.exp(x), jnp.log(abs(x)), jnp.sqrt(abs(x)), jnp.tanh(x), jnp.cosh(x)),
        *(jnp.sinh(x), jnp.sin(x), jnp.cos(x), jnp.tan(x), jnp.arctan2(x, y)),
        *(jnp.arctan(x), jnp.arcsin(u), jnp.arccos(u), jnp.arctanh(u), jnp.cbrt(x)),
        *(jnp.expm1(x), jnp.log1p(abs(x)), jnp.exp2(x), abs(x) ** y, jnp.hypot(x, y)),
        *(jax.nn.sigmoid(x), lax.rsqrt(abs(x)), jnp.arcsinh(x), jnp.arccosh(2 + x * x)),
        *(*sincos(x), log2(abs(x)), exp2(y), arctan(x), lax.erf(x)),
        *jax.tree.leaves(attitude(x, y, x)),
        *jax.vmap(sincos)(vector),
        *(vector @ vector, GRID[:, :3] @ vector, jnp.sum(vector), jnp.max(vector)),
        *(
            jnp.cumsum(vector),
            jnp.prod(vector),
            vector[::-1],
            jnp.outer(vector, vector),
        ),
        jnp.linalg.norm(vector),
        lax.fori_loop(0, 5, lambda n, v: v * u + n, y),
        lax.scan(lambda c, r: (c + r, c * r), x, vector),
        _root(x),
        _root(y),
        *jax.tree.leaves(SechFunction(1.0, 0.2, 100.0)(10.0 * abs(y))),
        *jax.tree.leaves(vertical_schedule().at(200.0 * abs(y))),
        jnp.where(k > 0, Channels(x, y, x).pitch, p["p"]),
    ]


@needs_compiler
def test_elementwise_primitives_are_those_of_jax_on_wild_numbers(tmp_path):
    agree(compiled(tmp_path, everything), everything, cases())


@needs_compiler
def test_functions_and_small_arrays_are_those_of_jax(tmp_path):
    tame = [-3.1, -0.7, 1e-3, 0.4, 1.9, 2.6]
    agree(compiled(tmp_path, smooth), smooth, cases(tame), rtol=2e-13)


def _refused(function):
    example = jax.eval_shape(function, {}, EXAMPLE)
    with pytest.raises(ExportError) as error:
        write_function(
            "compute",
            "It.",
            lambda p, g: (function(p, g),),
            ("constants", {}),
            [
                Argument("in", Structure("given", "In.", EXAMPLE)),
                Argument("out", Structure("result", "Out.", example), False, True),
            ],
            Functions(),
        )
    return str(error.value)


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (
            lambda p, g: lax.while_loop(lambda v: v < 9.0, lambda v: v + 1, g["x"]),
            "while",
        ),
        (lambda p, g: jnp.sort(jnp.stack([g["x"], g["y"]])), "sort"),
        (lambda p, g: lax.lgamma(g["x"]), "lgamma"),
        (lambda p, g: lax.bitcast_convert_type(g["x"], jnp.int64), "bitcast_convert"),
        (lambda p, g: lax.div(g["k"], g["m"]), "div"),
        (lambda p, g: g["k"] << g["m"], "shift"),
        (lambda p, g: g["x"].astype(jnp.float16), "float16"),
        (lambda p, g: jnp.fft.fft(jnp.stack([g["x"], g["y"]])).real, "complex128"),
    ],
)
def test_what_has_no_form_in_c_is_refused_by_name(function, name):
    said = _refused(function)
    assert name in said
    assert "cannot be exported" in said


def grown(p, g):
    """Arrays and loops as filters have them: products, slopes, places."""
    x, y, k = g["x"], g["y"], g["k"]
    square = jnp.sin(x + p["p"] * jnp.arange(100.0)).reshape(10, 10)
    row = jnp.stack([x, y, x * y])
    wide = jnp.cos(y + p["p"] * jnp.arange(900.0)).reshape(30, 30)

    def turned(at):
        step = lambda v, n: (jnp.sin(v) * y + 0.1 * n, v[0])
        end, said = lax.scan(step, at, jnp.arange(70.0))
        return end + said[3]

    def within(carry, rows):
        many, flag = carry
        end, _ = lax.scan(lambda v, n: (jnp.cos(v + n), None), many, jnp.arange(80.0))
        return (end, flag + k + (end[0] > rows)), end[:2]

    (many, count), said = lax.scan(
        within, (square[0], k), jnp.linspace(-1.0, 1.0, 12) * x, reverse=True
    )
    return [
        square @ square.T,
        square @ square[0],
        wide @ wide[0],
        wide[1] @ wide,
        jnp.diagonal(square),
        jnp.diag(row),
        row.at[1].set(y).at[0].add(x),
        square.at[2, 3].add(y)[2],
        jnp.pad(row, (1, 2), constant_values=y),
        *jnp.split(row, [1]),
        jax.jacfwd(turned)(row),
        lax.fori_loop(0, 100, lambda n, v: 0.9 * v + y, x),
        *(many, count, said),
    ]


@needs_compiler
def test_loops_and_matrices_are_those_of_jax(tmp_path):
    call = compiled(tmp_path, grown)
    agree(call, grown, cases([-3.1, 1e-3, 0.4]), rtol=1e-12)
    text = (tmp_path / "code.c").read_text()
    assert text.count("for (int n = 0; n < 70; n++)") == 1
    assert "real_product(" in text


def test_wide_tables_and_places_known_on_board_only_are_refused():
    said = _refused(lambda p, g: jnp.zeros(4).at[g["k"]].set(g["x"]))
    assert "scatter" in said
    assert "a place known on board only" in said
    wide = jnp.zeros((40, 40))
    said = _refused(lambda p, g: wide[g["k"], g["m"]])
    assert "1600 places" in said


def test_equal_statements_are_shared_and_unused_ones_left_out():
    block = Block()
    a, b = (block.load("real", n, f"in->{n}") for n in "ab")
    first = block.compute("real", "a + b", (a, b), "add")
    assert block.compute("real", "a + b", (a, b), "add") == first
    unused = block.compute("real", "a * b", (a, b), "mul")
    kept = block.needed([first])
    assert [s.defines[0][0] for s in kept] == ["a", "b", first.text]
    assert unused.text not in " ".join(s.text for s in kept)


def test_calls_that_come_again_become_one_function():
    functions = Functions()
    write_function(
        "compute",
        "It.",
        lambda p, g: ((_root(g["x"]), _root(g["y"])),),
        ("constants", {}),
        [
            Argument("in", Structure("given", "In.", EXAMPLE)),
            Argument("out", Structure("result", "Out.", (1.0, 1.0)), False, True),
        ],
        functions,
    )
    assert [f.name for f in functions.outlined.values()] == ["newton_root_1"]


def test_fields_have_legal_names_and_the_comments_of_their_classes():
    tree = {
        "float": jnp.zeros(2),
        "2 x": jnp.zeros(()),
        "P": SechFunction(1.0, 0.2, 9.0),
    }
    fields = {f.name: f for f in fields_of(tree)}
    assert set(fields) == {
        "x_float",
        "x_2_x",
        "P_initial",
        "P_final_bound",
        "P_settling_time",
    }
    assert fields["x_float"].declaration() == "glider_real x_float[2];"
    assert fields["P_settling_time"].comment == "T [s]"
