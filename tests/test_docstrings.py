"""Docstrings say what a thing is: every line about a field or argument has a noun."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [
    *sorted((ROOT / "jaxglider").rglob("*.py")),
    *sorted((ROOT / "tuning").rglob("*.py")),
]
SECTIONS = ("Attributes", "Args", "Returns", "Raises", "Yields")
NO_NOUN = """
    about added along also and as at because before between both by does done for from
    given gives had has have holds how if in is it its kept likewise made makes may
    must of on or over said see seen shared so taken takes that the-same their theirs
    them these they this those through to told under up upon was were what when where
    which whose with within without
"""
"""Words that begin a line whose noun is left to the reader."""
QUESTIONS = ("As", "How", "In", "It", "Of", "What", "Where", "Who", "Whose")
"""Words that begin a summary of which the reader has to guess what it is about."""
MANY = 3
"""A public function with this many arguments has to explain them."""


def documented(tree):
    """The module itself and every definition in it, with its qualified name."""

    def walk(node, prefix):
        for child in node.body:
            if isinstance(child, ast.ClassDef | ast.FunctionDef):
                name = prefix + child.name
                yield name, child
                yield from walk(child, name + ".")

    yield "module", tree
    yield from walk(tree, "")


def lines_of(docstring, section):
    """Names and texts of the entries of one section of a Google docstring."""
    entries, inside = [], False
    for line in docstring.splitlines():
        text, indent = line.strip(), len(line) - len(line.lstrip())
        if text.rstrip(":") in SECTIONS and text.endswith(":") and indent == 0:
            inside = text == section + ":"
        elif inside and text and indent == 4:
            name, _, rest = text.partition(": ")
            entries.append((name.strip("*"), rest))
        elif inside and text and indent == 0:
            inside = False
    return entries


def first_word(text):
    words = [word.strip(",;:.") for word in text.lower().split()]
    if words[:2] == ["the", "same"]:
        return "the-same"
    return words[0] if words else "of"


def parameters(function):
    """Names of the arguments of a function, its own object left out."""
    spec = function.args
    positional = [*spec.posonlyargs, *spec.args]
    names = [a.arg for a in (*positional, *spec.kwonlyargs)]
    names += [a.arg for a in (spec.vararg, spec.kwarg) if a is not None]
    return [name for name in names if name not in ("self", "cls")]


def fields(kind):
    """Names of the fields and properties of a class."""
    return {
        *(n.target.id for n in kind.body if isinstance(n, ast.AnnAssign)),
        *(n.name for n in kind.body if isinstance(n, ast.FunctionDef)),
        *re.findall(r"self\.(\w+)", ast.unparse(kind)),
    }


def complaints(source):
    """Violations of the rules in the docstrings of a module."""
    tree = ast.parse(source)
    for name, node in documented(tree):
        text = ast.get_docstring(node) or ""
        if text.startswith(tuple(word + " " for word in QUESTIONS)):
            yield f"{name}: the summary {text.splitlines()[0]!r} names no thing"
        is_class = isinstance(node, ast.ClassDef)
        entries = lines_of(text, "Attributes" if is_class else "Args")
        for entry, rest in entries:
            if first_word(rest) in NO_NOUN.split():
                yield f"{name}: {entry}: {rest!r} does not begin with a noun"
        if isinstance(node, ast.Module):
            continue
        known = fields(node) if is_class else parameters(node)
        for entry, _ in entries:
            if entry not in known:
                yield f"{name}: {entry} is documented and is not there"
        if is_class or name.rpartition(".")[2].startswith("_"):
            continue
        missing = set(known) - {entry for entry, _ in entries}
        if entries and missing:
            yield f"{name}: {', '.join(sorted(missing))} not documented"
        if len(known) >= MANY and not entries and "." not in name:
            yield f"{name}: {len(known)} arguments and none documented"
    yield from constants(tree)


def constants(tree):
    """Violations of the rules in the docstrings of a module's constants."""
    for node, following in zip(tree.body, tree.body[1:], strict=False):
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        text = getattr(getattr(following, "value", None), "value", None)
        if isinstance(following, ast.Expr) and isinstance(text, str):
            name = ast.unparse(node).split("=")[0].split(":")[0].strip()
            if not text.endswith(".") or first_word(text) in NO_NOUN.split():
                yield f"{name}: {text!r} is no description"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_docstrings_describe_by_nouns_what_is_there(path):
    assert list(complaints(path.read_text(encoding="utf-8"))) == []


def function(signature, entry):
    return f'def f({signature}):\n    """F.\n\n    Args:\n        {entry}\n    """'


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ('"""How it is."""', "names no thing"),
        ('LIMIT = 1\n"""Of a line."""', "no description"),
        ('LIMIT = 1\n"""Largest length"""', "no description"),
        (function("x", "x: of it."), "does not begin with a noun"),
        (function("x", "x: the same."), "does not begin with a noun"),
        (function("x", "y: end."), "is not there"),
        (function("x, y", "x: end."), "y not documented"),
        ('def f(a, b, c, d):\n    """F."""', "none documented"),
        (
            'class A:\n    """A.\n\n    Attributes:\n        x: end.\n    """',
            "not there",
        ),
    ],
    ids=range(9),
)
def test_the_rules_find_what_they_forbid(source, complaint):
    assert any(complaint in text for text in complaints(source))
