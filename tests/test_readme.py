"""Every code block of the README runs, and its commands exist."""

import re
import shlex
from pathlib import Path

import pytest
from test_architecture import ROOMS

from tuning.cli.parser import parser

README = (Path(__file__).parents[1] / "README.md").read_text()


def _blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_python_blocks_run_one_after_the_other(capsys):
    blocks = _blocks("python")
    assert len(blocks) >= 3
    namespace: dict = {}
    for block in blocks:
        # A backend is running already under test: the optional call would only warn.
        exec(block.replace("jaxglider.enable_fast_loops()", "pass"), namespace)
    numbers = [float(line) for line in capsys.readouterr().out.split()]
    assert len(numbers) == 2
    assert all(0.0 < number < 2.0 for number in numbers)
    assert abs(float(namespace["slope"])) > 1e-3


def test_there_are_exactly_two_set_up_commands_each_complete():
    commands = [line for block in _blocks("sh") for line in block.splitlines()]
    assert len(commands) == 2
    for command in commands:
        assert command.startswith("python3 -m venv .venv && ")
        assert "pip install" in command
    assert commands[0].endswith("jaxglider tune")
    assert commands[1].endswith("pytest")


def test_every_command_named_parses():
    named = re.findall(r"^\| `jaxglider ([^`]*)`", README, flags=re.MULTILINE)
    assert len(named) >= 6
    for text in named:
        try:
            options = parser().parse_args(shlex.split(text))
        except SystemExit:
            pytest.fail(f"README names a command that does not parse: {text}")
        assert options.command == text.split()[0]


def test_the_organization_table_is_the_list_of_rooms():
    rows = re.findall(r"^\| `((?:jaxglider|tuning)/[\w/.]+)` \|", README, re.MULTILINE)
    named = [row.removesuffix(".py").replace("/", ".") for row in rows]
    rooms = [room for room in ROOMS if room not in ("jaxglider", "tuning")]
    tops = list(dict.fromkeys(".".join(room.split(".")[:2]) for room in rooms))
    tops.remove("tuning.__main__")
    assert named == tops
