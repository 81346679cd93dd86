"""Completion without a running system: candidates for a partial line, in each shell's format."""

import os
import sys
from importlib import import_module
from pathlib import Path

import pytest

from quadctl.cli import commands
from quadctl.cli.completion import engine
from quadctl.cli.completion.engine import candidates
from quadctl.cli.completion.shells import SCRIPTS, answer
from quadctl.cli.names import find_service, key_of
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.services.runtime.params.names import normal_name
from tests.support.command_line import Quadctl


def matching(found, begun: str) -> list[str]:
    """Return the candidates that begin with the typed part, as the engine filters them."""
    return sorted(word for word in found if word.startswith(begun))


def served(key: str, type_: str = "Calibrate") -> EndpointInfo:
    return EndpointInfo("uav", "@srv", "somebody", type_, "00000000", 0, key)


@pytest.mark.parametrize(
    ("begun", "words"),
    [
        ("", ["pose"]),
        ("p", ["pose"]),
        ("/", ["/pose"]),
        ("/p", ["/pose"]),
        ("u", ["uav/pose"]),
        ("/uav/p", ["/uav/pose"]),
        ("x", []),
    ],
)
def test_a_known_topic_is_completed(begun: str, words: list[str]):
    assert matching(engine.topic("uav/pose", begun, "uav"), begun) == words


@pytest.mark.parametrize("key", ["uav/foo", "foo", "other/pose", "uav/camera/left"])
def test_an_unknown_topic_is_completed_by_its_full_key(key: str):
    assert matching(engine.topic(key, "", "uav"), "") == [key]
    assert matching(engine.topic(key, f"/{key[:2]}", "uav"), "/") == [f"/{key}"]


@pytest.mark.parametrize("begun", ["", "/", "u", "/u"])
def test_every_completion_of_a_topic_means_its_key(begun: str):
    for key in (*(topic.key("uav") for topic in TOPICS), "uav/foo", "foo"):
        assert {key_of(word, "uav") for word in engine.topic(key, begun, "uav")} == {key}


def test_names_of_several_vehicles_are_completed_by_full_keys():
    assert [*engine.topic("uav1/pose", "", "*")] == ["uav1/pose"]
    assert [*engine.service(served("uav1/@srv/goto"), "", "*")] == ["uav1/@srv/goto"]
    assert [*engine.service(served("uav1/@srv/goto"), "/", "*")] == ["/uav1/goto"]


@pytest.mark.parametrize(
    ("begun", "words"),
    [
        ("cal", ["calibrate_pressure"]),
        ("/cal", ["/calibrate_pressure"]),
        ("/uav/cal", ["/uav/calibrate_pressure"]),
        ("uav/", ["uav/@srv/calibrate_pressure"]),
        ("/uav/@", ["/uav/@srv/calibrate_pressure"]),
    ],
)
def test_a_known_service_is_completed(begun: str, words: list[str]):
    offer = served("uav/@srv/calibrate_pressure")
    assert matching(engine.service(offer, begun, "uav"), begun) == words


@pytest.mark.parametrize("begun", ["", "/", "u", "/u", "/uav/@"])
def test_every_completion_of_a_service_finds_it(begun: str):
    for known in SERVICES:
        for word in engine.service(served(known.key("uav")), begun, "uav"):
            assert find_service(word, "uav") is known
    get = served("uav/@srv/mine/get_params", "GetParams")
    for word in engine.service(get, begun, "uav"):
        assert find_service(word, "uav").name == "mine/get_params"


def test_a_users_own_service_is_completed():
    offer = served("uav/@srv/foo", "Own")
    assert [*engine.service(offer, "/f", "uav")] == ["/foo", "/uav/@srv/foo"]
    assert [*engine.service(served("foo/bar"), "", "uav")] == ["foo/bar"]


@pytest.mark.parametrize(
    ("begun", "words"),
    [
        ("saf", ["safety.takeoff"]),
        ("/saf", ["/safety/takeoff"]),
        ("safety/", ["safety/takeoff"]),
        ("uav.s", ["uav.safety.takeoff"]),
        ("/uav/s", ["/uav/safety/takeoff"]),
    ],
)
def test_a_parameter_is_completed(begun: str, words: list[str]):
    assert matching(engine.parameter("safety.takeoff", begun, "uav"), begun) == words


@pytest.mark.parametrize(("begun", "word"), [("", "safety.takeoff"), ("/s", "/safety/takeoff")])
def test_a_setting_is_completed(begun: str, word: str):
    assert [*engine.setting("safety.takeoff", begun)] == [word]
    assert normal_name(word) == "safety.takeoff"


@pytest.mark.parametrize(
    ("begun", "words"),
    [("saf", ["safety"]), ("/saf", ["/safety"]), ("/", ["/safety"]), ("/uav/", ["/uav/safety"])],
)
def test_a_node_is_completed(begun: str, words: list[str]):
    assert matching(engine.node("safety", begun, "uav"), begun) == words


INSTALLATION = "quadctl.cli.completion.installation"
BREAKS = " \t\n\"'@><=;|&(:"
COMMON = {"--realm", "--connect", "--identity", "--vehicle", "--timeout", "--json", "-h", "--help"}


def words(line: str) -> list[str]:
    """Return the candidates for the last word of a line after `quadctl`."""
    *before, begun = line.split(" ")
    return [fit.word for fit in candidates([word for word in before if word], begun)]


def bash(line: str, **more: str) -> list[str]:
    output = answer({"_QUADCTL_COMPLETE": "complete_bash", "COMP_WORDS": line} | more)
    assert output is not None
    return output.splitlines()


def test_the_first_word_completes_to_a_command_or_a_group():
    assert set(words("")) == {path.split()[0] for path in commands.COMMANDS} - commands.ALIASES
    assert words("cal") == ["calibrate"]
    assert words("--json --realm r cal") == ["calibrate"]
    assert words("nonsense ") == words("nonsense more ") == []


def test_the_second_word_completes_to_a_command_of_the_group():
    assert words("lab ") == ["check", "grade", "new", "rubric"]
    assert words("lab rubric ") == ["check"]
    assert words("cage ") == ["off", "on", "show"]
    assert words("cage --realm r o") == ["off", "on"]
    assert words("cage nonsense ") == words("cage on ") == []


def test_options_are_completed():
    own = {
        "--bridge", "--detach", "-d", "--insecure", "--listen", "--record", "--set", "--vehicles",
        "--without",
    }  # fmt: skip
    assert own | COMMON == set(words("up -"))
    assert set(words("cage -")) == COMMON
    assert COMMON | {"--version", "--install-completion", "--show-completion"} == set(words("-"))
    assert words("goto 1 -2 --re") == ["--realm", "--replace"]
    assert words("--rea") == ["--realm"]


@pytest.mark.parametrize("line", ["--realm ", "status --realm ", "status --timeout=", "up --x="])
def test_values_that_cannot_be_known_have_no_completion(line: str):
    assert words(line) == []


def test_settings_and_types_are_completed():
    assert words("up --set safety.tak") == ["safety.takeoff="]
    assert words("up --set /safety/tak") == ["/safety/takeoff="]
    assert words("up --set a=1 --set=safety.tak") == ["--set=safety.takeoff="]
    assert len(words("up quad.toml --set safety.virtual_cage.")) == 3
    assert "calibrate_pressure" in words("type show cal")


def test_only_missing_fields_of_a_request_are_completed():
    assert words("service call calibrate_pressure ") == ["zero="]
    assert words("service call /uav/@srv/goto x=1 ") == ["direct=", "replace=", "wait=", "y=", "z="]
    assert words("service call goto x=1 y") == ["y="]
    assert words("service call nonsense ") == []


def test_files_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "labs").mkdir()
    (tmp_path / "labs" / "a b.toml").touch()
    (tmp_path / "lab.toml").touch()
    (tmp_path / ".hidden").touch()
    monkeypatch.chdir(tmp_path)
    assert words("up lab") == ["lab.toml", "labs/"]
    assert words("up labs/") == ["labs/a b.toml"]
    assert words(f"init {tmp_path}/lab.") == [f"{tmp_path}/lab.toml"]
    assert words("up nowhere/") == words("status lab") == []


def test_without_a_run_there_are_no_live_names(quadctl: Quadctl):
    for line in ("topic echo ", "service info ", "param get ", "service call cal", "topic echo /"):
        assert words(line) == []
    assert words("--realm no/name topic echo ") == []


def test_bash_passes_the_line_with_or_without_a_word_index(
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


def test_bash_replaces_only_the_last_part_of_a_word():
    assert bash("quadctl up --set=safety.tak", COMP_WORDBREAKS=BREAKS) == ["safety.takeoff="]
    assert bash("quadctl up --set=safety.tak", COMP_WORDBREAKS=" ") == ["--set=safety.takeoff="]
    assert bash("quadctl service call calibrate_pressure ze", COMP_WORDBREAKS=BREAKS) == ["zero="]
    assert bash("quadctl up --set safety.virtual_cage.x", COMP_WORDBREAKS=BREAKS) == [
        "safety.virtual_cage.x="
    ]


@pytest.mark.parametrize(
    ("shell", "line", "expected"),
    [
        ("fish", "quadctl cage on", "on\tTurn the cage on; a flight to a goal outside is stopped."),
        ("fish", "quadctl service call calibrate_pressure ", "zero="),
        ("powershell", "quadctl service call calibrate_pressure z", "zero=::: "),
        ("zsh", "quadctl nonsense ", ""),
        (
            "zsh",
            "quadctl cage of",
            "local -a found=('off:Turn the cage and its zones off: every goal above the floor is accepted.'); _describe '' found ",
        ),
        (
            "zsh",
            "quadctl service call calibrate_pressure ",
            "local -a found=(zero=); _describe '' found -S ''",
        ),
    ],
)
def test_other_shells_get_their_own_format(shell: str, line: str, expected: str):
    environment = {"_QUADCTL_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line}
    assert answer(environment) == expected


def test_a_request_of_another_shell_is_refused(quadctl: Quadctl, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(os.environ, "_QUADCTL_COMPLETE", "complete_tcsh")
    assert answer() is answer({}) is None
    done = quadctl("init")
    assert (done[0], done[1]) == (1, "")
    assert done[2].startswith("error: there is no completion for tcsh\n")


def test_typer_installs_our_scripts():
    from typer._completion_shared import get_completion_script

    import_module(INSTALLATION)
    for shell in SCRIPTS:
        script = get_completion_script(
            prog_name="quadctl", complete_var="_QUADCTL_COMPLETE", shell=shell
        )
        assert f"_QUADCTL_COMPLETE=complete_{shell}" in script
        assert "%" not in script


def test_completion_does_not_import_typer(quadctl: Quadctl, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(os.environ, "_QUADCTL_COMPLETE", "complete_bash")
    monkeypatch.setitem(os.environ, "COMP_WORDS", "quadctl cage o")
    for name in [name for name in sys.modules if name == INSTALLATION or name.startswith("typer")]:
        monkeypatch.delitem(sys.modules, name)
    assert quadctl() == (0, "off\non\n", "")
    assert "typer" not in sys.modules
