"""The compliance checker of IOOS on files that we write.

It asks of every variable which of all the others are axes, times, bounds ...: of a file
that is only read it is told once.
"""

import contextlib
import copy
import functools
import inspect

from compliance_checker.cf import util
from compliance_checker.runner import CheckSuite

VERSIONS = ("cf:1.8", "cf:1.11")
"""The oldest that the files claim, and the newest."""


@functools.cache
def _suite():
    CheckSuite.load_all_available_checkers()
    return CheckSuite()


def complaints(path, versions=VERSIONS):
    """What the checker has to say about a file, its own failures included."""
    suite = _suite()
    with _told_once(), suite.load_dataset(str(path)) as file:
        results = suite.run_all(file, list(versions))
    assert set(results) == set(versions)
    texts = []
    for version, (groups, errors) in results.items():
        assert len(groups) > 20
        texts += [f"{version}: {name} failed: {e[0]}" for name, e in errors.items()]
        texts += [f"{version}: {text}" for group in groups for text in _failed(group)]
    return texts


@contextlib.contextmanager
def _told_once():
    """What the checker's functions of a file alone have found is kept."""
    plain = {
        name: function
        for name, function in inspect.getmembers(util, inspect.isfunction)
        if name.startswith("get_")
        and list(inspect.signature(function).parameters) == ["nc"]
    }
    for name, function in plain.items():
        setattr(util, name, _keeping(function))
    try:
        yield
    finally:
        for name, function in plain.items():
            setattr(util, name, function)


def _keeping(function):
    found = functools.cache(function)
    return lambda nc: copy.copy(found(nc))


def _failed(result):
    """Messages of a result that has not all its points, and of those within it."""
    if result.children:
        return [text for child in result.children for text in _failed(child)]
    points = result.value
    passed = points[0] == points[1] if isinstance(points, tuple) else bool(points)
    return [] if passed else [f"{result.name}: {text}" for text in result.msgs or [""]]
