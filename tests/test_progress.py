"""Progress where nobody looks: one line a minute, and none once it is over."""

import gc
import time

import pytest

from tuning.reporting import console


@pytest.fixture
def quick(monkeypatch):
    """A minute of 0.05 s."""
    monkeypatch.setattr(console, "MINUTE", 0.05)
    monkeypatch.setattr(console, "PATIENCE", 0.0)


def wait_for(capsys, lines):
    """What is on standard error once it has some lines."""
    seen, end = "", time.monotonic() + 20.0
    while seen.count("\n") < lines and time.monotonic() < end:
        time.sleep(0.02)
        seen += capsys.readouterr().err
    return seen


def test_a_pipe_is_told_now_and_then_what_is_being_done(quick, capsys):
    progress = console.Progress()
    progress.show("compiling ...")
    seen = wait_for(capsys, 2)
    assert seen.startswith("jaxglider: compiling ... 0 s\n")
    progress.clear()
    capsys.readouterr()
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_a_pipe_hears_nothing_of_what_is_quick(capsys):
    progress = console.Progress()
    progress.show("compiling ...")
    progress.clear()
    assert capsys.readouterr().err == ""


def test_a_line_that_nobody_has_any_more_is_not_said_again(quick, capsys):
    progress = console.Progress()
    progress.show("compiling ...")
    del progress
    gc.collect()
    time.sleep(0.15)
    capsys.readouterr()
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
