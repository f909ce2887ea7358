"""Laws and functions of a user's own, named as FILE.py:NAME.

A law of one's own is a class in a Python file, an `AbstractController`. It is asked for
as `FILE.py:ClassName` wherever a law of the catalogue is asked for by its name: on the
command line, and as `type` of the table `controller` in mission and gains files.

Its first instance is made by its class method `initial(model, funnel)` if it has one.
Else the class is called: a field `model` gets the design model, a field `funnel` the
funnel of the case, and every other field its default.
"""

import dataclasses
import hashlib
import sys
import types
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider import paper
from jaxglider.control.catalogue import BY_NAME, LawEntry
from jaxglider.control.controller import AbstractController, ControlRecord
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.steering import AbstractSteering
from jaxglider.core.toml import ConfigError, reason
from jaxglider.files.law_paths import is_own, short_name
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    zeros,
)
from jaxglider.simulation.gains import LoadedGains
from jaxglider.vehicle.design_model import DesignModel

_PREFIX = "_jaxglider_user_"


def label_of(kind: str) -> str:
    """Name of a law for tables: of the catalogue, or of the class."""
    return BY_NAME[kind].label if kind in BY_NAME else short_name(kind)


def law_entry(kind: str, owner: str = "controller") -> LawEntry:
    """A law as the catalogue lists it; one of the user's own, as if it were there.

    A law of one's own flies with the fixed-time observer where nothing else is asked
    for.

    Args:
        kind: name in the catalogue, or FILE.py:ClassName.
        owner: option or key that names it, for messages.

    Raises:
        ConfigError: there is no such law.
    """
    if kind in BY_NAME:
        return BY_NAME[kind]
    return _entry(kind, owner, None)


def first_gains(
    kind: str,
    scenario: str,
    model: DesignModel,
    funnel: Funnel | None = None,
    text: str | None = None,
    steering: AbstractSteering | None = None,
) -> LoadedGains:
    """A law with the gains it begins with, and its observer with the paper's.

    Args:
        kind: name in the catalogue, for the paper's gains, or FILE.py:ClassName.
        scenario: `switching` or `waypoints`, the case whose gains are taken.
        model: design model.
        funnel: funnel for a law of one's own; the paper's by default.
        text: text of the Python file where it is kept elsewhere.
        steering: way that a law of the catalogue steers; its plant's by default.

    Raises:
        ConfigError: there is no such law, or it cannot be made or used.
    """
    if kind in BY_NAME:
        return paper.make_law(kind, scenario, model, steering)
    entry = _entry(kind, "controller.type", text)
    if funnel is None:
        funnel = paper.funnel(scenario)
    controller = _instance(entry, model, funnel)
    _check_step(kind, controller)
    return LoadedGains(kind, controller, paper.make_observer(entry.observer, model))


def spec_of(cls: type) -> str | None:
    """FILE.py:ClassName of a class that was loaded from a file, or None."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    if not file or cls.__module__.startswith("jaxglider.") or "." in cls.__qualname__:
        return None
    return f"{file}:{cls.__name__}"


def source_of(kind: str) -> str:
    """Text of the file that a law of one's own is in.

    Raises:
        ConfigError: the file cannot be read.
    """
    return _text(kind.rpartition(":")[0], "controller.type", "ClassName", kind)


def load_named(where: str, owner: str, what: str, text: str | None = None) -> Any:
    """The object that a Python file calls by a name.

    Args:
        where: FILE.py:NAME.
        owner: option or key that names it, for messages.
        what: kind of thing it names, for messages, as `FUNCTION` or `ClassName`.
        text: text of the file, where it is kept elsewhere.

    Raises:
        ConfigError: there is no such file or name, or the file cannot be run.
    """
    path, _, name = where.rpartition(":")
    if text is None:
        text = _text(path, owner, what, where)
    module = _module(path, text, owner)
    try:
        return vars(module)[name]
    except KeyError:
        kind = type if what == "ClassName" else types.FunctionType
        names = [
            word
            for word, thing in vars(module).items()
            if isinstance(thing, kind) and thing.__module__ == module.__name__
        ]
        there = f"it has {', '.join(names)}" if names else "it has none"
        raise ConfigError(f"{owner}: {path} has no {what} {name!r}; {there}.") from None


def _text(path: str, owner: str, what: str, where: str) -> str:
    if not path or not Path(path).is_file():
        raise ConfigError(
            f"{owner} must be FILE.py:{what} with an existing file; received {where!r}."
        )
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{owner}: {path} cannot be read: {reason(error)}."
        ) from error


def _module(path: str, text: str, owner: str) -> types.ModuleType:
    """The file run as a module; once for as long as its text stays the same."""
    name = _PREFIX + hashlib.sha256(f"{path}\n{text}".encode()).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    module = types.ModuleType(name)
    module.__file__ = path
    # Dataclasses look their module up while the file is still being run.
    sys.modules[name] = module
    try:
        exec(compile(text, path, "exec"), vars(module))
    except Exception as error:
        del sys.modules[name]
        raise ConfigError(f"{owner}: {path} cannot be run: {error!r}.") from error
    return module


def _entry(kind: str, owner: str, text: str | None) -> LawEntry:
    if not is_own(kind):
        raise ConfigError(
            f"{owner} must be one of {', '.join(BY_NAME)}, or FILE.py:ClassName for a "
            f"law of your own; received {kind!r}."
        )
    cls = load_named(kind, owner, "ClassName", text)
    if not isinstance(cls, type) or not issubclass(cls, AbstractController):
        raise ConfigError(
            f"{owner} must name a class that is a jaxglider.AbstractController; "
            f"{kind} is {cls!r}."
        )
    return LawEntry(kind, cls, cls.__name__)


def _instance(
    entry: LawEntry, model: DesignModel, funnel: Funnel
) -> AbstractController:
    """The first instance of a law of one's own; see the text of the module."""
    initial = getattr(entry.cls, "initial", None)
    fields = {f.name: f for f in dataclasses.fields(entry.cls) if f.init}
    known: dict[str, Any] = {"model": model, "funnel": funnel}
    try:
        if initial is not None:
            law = initial(model, funnel)
        else:
            law = entry.cls(**{n: x for n, x in known.items() if n in fields})
    except Exception as error:
        raise ConfigError(
            f"{entry.name} cannot be made: {error}. Give it a class method "
            "initial(model, funnel), or every field but model and funnel a default."
        ) from error
    if not isinstance(law, entry.cls):
        raise ConfigError(
            f"{entry.name}: initial(model, funnel) must return a {entry.label}; "
            f"received {law!r}."
        )
    return law


def _check_step(kind: str, law: AbstractController) -> None:
    """Refuse a law whose step does not return what the closed loop needs.

    Nothing is computed: shapes and types alone are followed through one tick.
    """
    zero = jnp.zeros((), jnp.result_type(float))
    state = zeros(GliderState, zero)
    three = zeros(Channels, zero)
    measurement = Measurement(
        state, state.attitude(), zeros(Command, zero), zeros(BodyAxes, zero)
    )
    finished, target = jnp.asarray(False), jnp.asarray(0, jnp.int32)
    reference = Reference(three, three, three, zero, target, finished)

    def tick() -> tuple[Any, Any]:
        memory = law.init()
        bounds = law.bounds(reference.clock)
        return memory, law.step(memory, measurement, reference, bounds, zero)

    try:
        memory, result = jax.eval_shape(tick)
    except Exception as error:
        raise ConfigError(f"{kind}: one tick of it cannot be run: {error}") from error
    wanted = (
        jax.eval_shape(lambda: zeros(Command, zero)),
        memory,
        jax.eval_shape(lambda: ControlRecord(three, three)),
    )
    parts = result if isinstance(result, tuple) and len(result) == 3 else (result,)
    names = ("the command", "the next state", "the record")
    if len(parts) != len(names):
        raise ConfigError(
            f"{kind}: step must return three things, the command, the next state and "
            f"a ControlRecord; received {_words(result)}."
        )
    for name, got, rule in zip(names, parts, wanted, strict=True):
        if _words(got) != _words(rule):
            raise ConfigError(
                f"{kind}: {name} that step returns must be {_words(rule)}; received "
                f"{_words(got)}."
            )


def _words(tree: Any) -> str:
    """A pytree of shapes in words: where each number stands, and its type."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    numbers = [
        f"{jax.tree_util.keystr(path)} {leaf.dtype.name}{list(leaf.shape) or ''}"
        for path, leaf in leaves
    ]
    return f"{type(tree).__name__}({', '.join(numbers)})"
