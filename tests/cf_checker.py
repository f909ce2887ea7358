"""The compliance checker of IOOS on files that we write."""

import functools

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
    with suite.load_dataset(str(path)) as file:
        results = suite.run_all(file, list(versions))
    assert set(results) == set(versions)
    texts = []
    for version, (groups, errors) in results.items():
        assert len(groups) > 20
        texts += [f"{version}: {name} failed: {e[0]}" for name, e in errors.items()]
        texts += [f"{version}: {text}" for group in groups for text in _failed(group)]
    return texts


def _failed(result):
    """Messages of a result that has not all its points, and of those within it."""
    if result.children:
        return [text for child in result.children for text in _failed(child)]
    points = result.value
    passed = points[0] == points[1] if isinstance(points, tuple) else bool(points)
    return [] if passed else [f"{result.name}: {text}" for text in result.msgs or [""]]
