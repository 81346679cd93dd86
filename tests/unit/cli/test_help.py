"""Help texts: every command has a description and an example."""

import os
import re

import pytest

from quadctl.cli.commands import COMMANDS, meaning
from quadctl.cli.help_pages import page
from tests.support.command_line import Quadctl

GROUPS = sorted({path.split()[0] for path in COMMANDS if " " in path})
COMMON = ("--realm", "--connect", "--identity", "--vehicle", "--timeout", "--json")


@pytest.mark.parametrize("path", COMMANDS)
def test_help_of_every_command_describes_it_with_common_options(quadctl: Quadctl, path: str):
    result = quadctl(*path.split(), "--help")
    assert (result.code, result.err) == (0, "")
    assert re.match(rf"Usage: .*quadctl {path} ", result.out)
    places = [result.out.index(f"  {option} ") for option in COMMON]
    own = re.findall(r"^  (?:-\w, )?(--[\w-]+)", result.out, re.MULTILINE)
    assert own[-len(COMMON) - 1 :] == [*COMMON, "--help"], "the common options come last"
    assert places == sorted(places)
    assert meaning(path).endswith(".")


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_shows_an_example_of_itself(quadctl: Quadctl, path: str):
    shown = re.findall(r"Example: quadctl (.*)", quadctl(*path.split(), "--help").out)
    assert shown
    assert shown[0].startswith("status" if path == "ps" else path)


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_alone_lists_its_commands(quadctl: Quadctl, group: str):
    result = quadctl(group, "--help")
    assert result.code == 0
    for path in COMMANDS:
        if path.startswith(f"{group} "):
            assert path.split()[1] in result.out


def test_the_top_level_help_lists_every_command_but_the_alias(quadctl: Quadctl):
    result = quadctl("--help")
    assert result.code == 0
    listed = set(re.findall(r"^  (\w+) ", result.out, re.MULTILINE))
    assert {path.split()[0] for path in COMMANDS} - {"ps"} <= listed
    assert "ps" not in listed


def test_the_top_level_help_explains_exit_codes_and_completion(quadctl: Quadctl):
    result = quadctl("--help")
    for code in (0, 1, 2, 3, 4, 5, 6, 7, 8, 130):
        assert re.search(rf"Exit codes:.* {code} ", result.out)
    assert "--install-completion" in result.out


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("help", "--help"),
        ("-h", "--help"),
        ("help goto", "goto --help"),
        ("goto -h", "goto --help"),
        ("help topic echo", "topic echo --help"),
        ("help topic", "topic --help"),
    ],
)
def test_other_spellings_of_help_work(quadctl: Quadctl, typed: str, meant: str):
    assert quadctl(*typed.split()) == quadctl(*meant.split())


@pytest.mark.parametrize(
    ("line", "message", "hint"),
    [
        ("calibrat", "No such command 'calibrat'. Did you mean 'calibrate'?", "quadctl --help"),
        ("topic ech", "No such command 'ech'. Did you mean 'echo'?", "quadctl topic --help"),
        ("help topic ech", "Did you mean 'echo'?", "quadctl topic --help"),
        ("up --wihtout hub", "--without", "quadctl up --help"),
        ("up --set", "requires an argument", "quadctl up --help"),
        ("goto 1 2", "Missing argument 'Z'", "quadctl goto --help"),
        ("goto 1,-2,1.5", "'1,-2,1.5' is not a valid float", "quadctl goto 1 -2 1.5"),
        ("stop", "No such command 'stop'.", "quadctl hold"),
        ("--realm lab launch", "No such command 'launch'.", "quadctl up -d"),
    ],
)
def test_a_misspelt_line_gets_a_suggestion(quadctl: Quadctl, line: str, message: str, hint: str):
    result = quadctl(*line.split())
    assert result.code == 2
    assert message in result.err
    assert f"try: `{hint}`" in result.err


def test_piped_help_has_one_line_per_item_at_any_width(
    quadctl: Quadctl, monkeypatch: pytest.MonkeyPatch
):
    wide = quadctl("--help").out
    monkeypatch.setenv("COLUMNS", "20")
    for path in COMMANDS:
        if " " not in path and path != "ps":
            assert re.search(rf"^  {path} +{re.escape(meaning(path))}$", wide, re.MULTILINE)
    assert quadctl("--help").out == wide


@pytest.mark.parametrize("words", ["--help", "up --help", "topic --help"])
def test_piped_help_has_no_box_and_no_colour(quadctl: Quadctl, words: str):
    assert not set(quadctl(*words.split()).out) & set("╭│╰─\x1b")


@pytest.mark.parametrize("path", ["", "goto", "topic", "up", "fleet goto"])
def test_on_a_terminal_long_lines_are_broken_below_their_beginning(
    monkeypatch: pytest.MonkeyPatch, path: str
):
    piped = page(path)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("os.get_terminal_size", lambda: os.terminal_size((60, 24)))
    broken = page(path)
    assert broken.split() == piped.split()
    assert max(map(len, broken.splitlines())) <= 60 < max(map(len, piped.splitlines()))


def test_the_version_is_printed(quadctl: Quadctl):
    result = quadctl("--version")
    assert result.code == 0
    assert re.fullmatch(r"quadctl \d+\.\d+\.\d+\n", result.out)
