"""Help: every command says what it does, and the main ones show how."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from cli import typed
from tests.cli.quadctl import Quadctl

MAIN_VERBS = {
    "up", "down", "status", "ps", "init", "demo", "calibrate", "goto", "hold", "reset", "state", "fly",
    "campaign", "doctor", "record", "replay", "plot", "topic echo", "service info", "service call",
    "param list", "param get", "param set", "type show",
}  # fmt: skip


def commands(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    for name, inner in getattr(command, "commands", {}).items():
        here = f"{path} {name}".lstrip()
        if getattr(inner, "commands", None):
            yield from commands(inner, here)
        else:
            yield here, inner


COMMANDS = dict(commands(typer.main.get_command(typed.build())))
GROUPS = sorted({path.split()[0] for path in COMMANDS if " " in path})
COMMON = ("--realm", "--connect", "--vehicle", "--timeout", "--json")


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_says_what_it_does_and_has_the_common_options(quadctl: Quadctl, path: str):
    said = quadctl(*path.split(), "--help")
    assert (said.code, said.err) == (0, "")
    assert re.match(rf"Usage: .*quadctl {path} ", said.out)
    assert all(option in said.out for option in COMMON)
    assert (COMMANDS[path].help or "").partition("\n")[0].rstrip().endswith(".")


@pytest.mark.parametrize("path", sorted(MAIN_VERBS & set(COMMANDS)))
def test_a_main_verb_shows_an_example_of_itself(quadctl: Quadctl, path: str):
    shown = re.findall(r"Example: quadctl (.*)", quadctl(*path.split(), "--help").out)
    assert shown
    assert shown[0].startswith("status" if path == "ps" else path)


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_alone_lists_its_commands(quadctl: Quadctl, group: str):
    said = quadctl(group, "--help")
    assert said.code == 0
    for path in COMMANDS:
        if path.startswith(f"{group} "):
            assert path.split()[1] in said.out


def test_the_first_help_lists_every_command_but_the_alias(quadctl: Quadctl):
    said = quadctl("--help")
    assert said.code == 0
    listed = set(re.findall(r"^  (\w+) ", said.out, re.MULTILINE))
    assert {path.split()[0] for path in COMMANDS} - {"ps"} <= listed
    assert "ps" not in listed


@pytest.mark.parametrize("words", ["--help", "up --help", "topic --help"])
def test_piped_help_has_no_box_and_no_colour(quadctl: Quadctl, words: str):
    assert not set(quadctl(*words.split()).out) & set("╭│╰─\x1b")


def test_the_version(quadctl: Quadctl):
    said = quadctl("--version")
    assert said.code == 0
    assert re.fullmatch(r"quadctl \d+\.\d+\.\d+\n", said.out)
