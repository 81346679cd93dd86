"""Completion without a running system: the line so far in, what fits out, as each shell has it."""

import os
import sys
from pathlib import Path

import pytest

from quadctl.cli import commands, typer_app
from quadctl.cli.completion.engine import candidates
from quadctl.cli.completion.shells import SCRIPTS, answer
from tests.cli.quadctl import Quadctl

BREAKS = " \t\n\"'@><=;|&(:"
COMMON = {"--realm", "--connect", "--identity", "--vehicle", "--timeout", "--json", "--help"}


def words(line: str) -> list[str]:
    """What fits at the end of a line after `quadctl`."""
    *before, begun = line.split(" ")
    return [fit.word for fit in candidates([word for word in before if word], begun)]


def bash(line: str, **more: str) -> list[str]:
    said = answer({"_QUADCTL_COMPLETE": "complete_bash", "COMP_WORDS": line} | more)
    assert said is not None
    return said.splitlines()


def test_the_first_word_is_a_command_or_a_group():
    assert set(words("")) == {path.split()[0] for path in commands.COMMANDS} - commands.ALIASES
    assert words("cal") == ["calibrate"]
    assert words("--json --realm r cal") == ["calibrate"]
    assert words("nonsense ") == words("nonsense more ") == []


def test_the_second_word_of_a_group():
    assert words("cage ") == ["off", "on", "show"]
    assert words("cage --realm r o") == ["off", "on"]
    assert words("cage nonsense ") == words("cage on ") == []


def test_options():
    own = {
        "--detach", "-d", "--insecure", "--listen", "--record", "--set", "--vehicles", "--without"
    }  # fmt: skip
    assert own | COMMON == set(words("up -"))
    assert set(words("cage -")) == COMMON
    assert COMMON | {"--version", "--install-completion", "--show-completion"} == set(words("-"))
    assert words("goto 1 -2 --re") == ["--realm", "--replace"]
    assert words("--rea") == ["--realm"]


@pytest.mark.parametrize("line", ["--realm ", "status --realm ", "status --timeout=", "up --x="])
def test_what_nobody_can_know_is_left_open(line: str):
    assert words(line) == []


def test_settings_and_types():
    assert words("up --set safety.tak") == ["safety.takeoff="]
    assert words("up --set /safety/tak") == ["/safety/takeoff="]
    assert words("up --set a=1 --set=safety.tak") == ["--set=safety.takeoff="]
    assert len(words("up quad.toml --set safety.virtual_cage.")) == 3
    assert "calibrate_pressure" in words("type show cal")


def test_fields_of_a_service_that_are_not_given_yet():
    assert words("service call calibrate_pressure ") == ["zero="]
    assert words("service call /uav/@srv/goto x=1 ") == ["replace=", "y=", "z="]
    assert words("service call goto x=1 y") == ["y="]
    assert words("service call nonsense ") == []


def test_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "labs").mkdir()
    (tmp_path / "labs" / "a b.toml").touch()
    (tmp_path / "lab.toml").touch()
    (tmp_path / ".hidden").touch()
    monkeypatch.chdir(tmp_path)
    assert words("up lab") == ["lab.toml", "labs/"]
    assert words("up labs/") == ["labs/a b.toml"]
    assert words(f"init {tmp_path}/lab.") == [f"{tmp_path}/lab.toml"]
    assert words("up nowhere/") == words("status lab") == []


def test_where_nothing_runs_there_are_no_live_names(quadctl: Quadctl):
    for line in ("topic echo ", "service info ", "param get ", "service call cal", "topic echo /"):
        assert words(line) == []
    assert words("--realm no/name topic echo ") == []


def test_bash_says_the_line_or_its_words_and_a_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "a b.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert bash("quadctl cage o") == ["off", "on"]
    assert bash("quadctl cage ") == bash("quadctl cage ", COMP_CWORD="2")
    assert bash("quadctl cage o more", COMP_CWORD="2") == ["off", "on"]
    assert bash("quadctl 'cal") == ["calibrate"]
    assert bash("quadctl init a") == [r"a\ b.toml"]
    assert bash("quadctl") == bash("quadctl ") == words("")


def test_bash_replaces_no_more_than_the_last_part_of_a_word():
    assert bash("quadctl up --set=safety.tak", COMP_WORDBREAKS=BREAKS) == ["safety.takeoff="]
    assert bash("quadctl up --set=safety.tak", COMP_WORDBREAKS=" ") == ["--set=safety.takeoff="]
    assert bash("quadctl service call calibrate_pressure ze", COMP_WORDBREAKS=BREAKS) == ["zero="]
    assert bash("quadctl up --set safety.virtual_cage.x", COMP_WORDBREAKS=BREAKS) == [
        "safety.virtual_cage.x="
    ]


@pytest.mark.parametrize(
    ("shell", "line", "said"),
    [
        ("fish", "quadctl cage on", "on\tTurn the cage on; a flight to a goal outside is stopped."),
        ("fish", "quadctl service call calibrate_pressure ", "zero="),
        ("powershell", "quadctl service call calibrate_pressure z", "zero=::: "),
        ("zsh", "quadctl nonsense ", ""),
        (
            "zsh",
            "quadctl cage of",
            "local -a found=('off:Turn the cage off: every goal is accepted.'); _describe '' found ",
        ),
        (
            "zsh",
            "quadctl service call calibrate_pressure ",
            "local -a found=(zero=); _describe '' found -S ''",
        ),
    ],
)
def test_other_shells(shell: str, line: str, said: str):
    environment = {"_QUADCTL_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line}
    assert answer(environment) == said


def test_anything_else_is_left_to_typer():
    assert answer({}) is answer({"_QUADCTL_COMPLETE": "source_bash"}) is None


def test_typer_installs_our_scripts():
    from typer._completion_shared import get_completion_script

    assert typer_app.build()
    for shell in SCRIPTS:
        script = get_completion_script(
            prog_name="quadctl", complete_var="_QUADCTL_COMPLETE", shell=shell
        )
        assert f"_QUADCTL_COMPLETE=complete_{shell}" in script
        assert "%" not in script


def test_it_needs_no_typer(quadctl: Quadctl, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(os.environ, "_QUADCTL_COMPLETE", "complete_bash")
    monkeypatch.setitem(os.environ, "COMP_WORDS", "quadctl cage o")
    for name in [
        name for name in sys.modules if name == "quadctl.cli.typer_app" or name.startswith("typer")
    ]:
        monkeypatch.delitem(sys.modules, name)
    assert quadctl() == (0, "off\non\n", "")
    assert "typer" not in sys.modules
