"""Common options before or after the verb, and lines that cannot be parsed."""

from collections.abc import Mapping
from typing import Any

import pytest

from quadctl.cli import command, context
from quadctl.cli.context import Options, about_node, about_parameters
from quadctl.services.runtime.errors import UsageError
from tests.support.command_line import Quadctl

OPTIONS = Options("nowhere", "", "uav", json=False, timeout=1.0)


@pytest.mark.parametrize(
    ("word", "left"),
    [
        ("safety.takeoff", "safety.takeoff"),
        ("/safety/takeoff=3", "/safety/takeoff=3"),
        ("uav.safety.takeoff=3", "safety.takeoff=3"),
        ("/uav/safety/takeoff", "safety.takeoff"),
        ("uav/mine/text=/uav/a=b", "mine.text=/uav/a=b"),
        ("/uav", ""),
        ("/", "/"),
        ("uavs.x", "uavs.x"),
    ],
)
def test_a_vehicle_in_a_parameter_name_is_split_off(word: str, left: str):
    options, words = about_parameters(OPTIONS, [word])
    assert (options.named, words) == ("uav", [left])


def test_parameters_of_different_vehicles_are_rejected():
    with pytest.raises(UsageError, match="different vehicles: safety, uav"):
        about_parameters(OPTIONS, ["/uav/safety", "safety"])


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("safety", "safety"),
        ("/safety", "/safety"),
        ("/uav/safety", "safety"),
        ("uav/state_safety_node/", "state_safety_node"),
        ("/uav", "/uav"),
        ("other/safety", "other/safety"),
    ],
)
def test_a_vehicle_in_a_node_name_is_split_off(name: str, left: str):
    assert about_node(OPTIONS, name) == (OPTIONS, left)


# Without a hub these commands exit with 3 at once, and name the realm they looked in.
PLACES = [
    ("{} status",), ("status {}",), ("{} ps",), ("{} topic list",), ("topic {} list",),
    ("topic list {}",), ("goto {} 1 -2 1.5",), ("goto 1 -2 1.5 {}",), ("param set {} a=1",),
    ("service call goto x=1 y=2 z=3 {}",),
]  # fmt: skip


@pytest.mark.parametrize("place", [place for (place,) in PLACES])
def test_common_options_are_accepted_anywhere(quadctl: Quadctl, place: str):
    result = quadctl(*place.format("--realm other --json").split())
    assert (result.code, result.out) == (3, "")
    assert result.error["code"] == "unreachable"
    assert "other" in result.error["message"]
    assert "quadctl up" in result.error["hint"]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Options]:
    """Return the list of the options of every command that ran."""
    found: list[Options] = []
    made = context.options_of

    def recording(values: Mapping[str, Any]) -> Options:
        found.append(made(values))
        return found[-1]

    monkeypatch.setattr(command, "options_of", recording)
    return found


def test_without_options_the_defaults_apply(quadctl: Quadctl, seen: list[Options]):
    quadctl("type", "list")
    assert seen[0] == Options("default", "", "", False, 3.0)


def test_command_line_overrides_environment_overrides_defaults(
    quadctl: Quadctl, seen: list[Options], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("QUADCTL_REALM", "theirs")
    monkeypatch.setenv("QUADCTL_VEHICLE", "drone")
    quadctl("type", "list")
    quadctl("type", "list", "--realm", "mine", "--vehicle", "bird")
    assert [(found.realm, found.vehicle) for found in seen] == [
        ("theirs", "drone"),
        ("mine", "bird"),
    ]


def test_the_option_nearest_to_the_verb_wins(quadctl: Quadctl, seen: list[Options]):
    quadctl("--timeout", 1, "--realm", "a", "type", "--timeout", 2, "list", "--timeout=0.5")
    assert (seen[0].timeout, seen[0].realm) == (0.5, "a")
    quadctl("--json", "--connect", "tls/host:7447", "type", "list")
    assert (seen[1].json, seen[1].connect) == (True, "tls/host:7447")


def test_options_do_not_leak_into_the_next_command(quadctl: Quadctl, seen: list[Options]):
    quadctl("type", "list", "--realm", "other", "--json")
    quadctl("type", "list")
    assert seen[1] == Options("default", "", "", False, 3.0)


WRONG = [
    "nonsense", "topic nonsense", "--nonsense", "status --nonsense", "status more", "goto",
    "goto 1 2", "goto 1 2 abc", "goto 1 2 3 4", "goto 1 2 3 --arrive soon", "type show",
    "status --timeout soon", "status --timeout 0", "status --timeout -1", "status --timeout nan",
    "status --timeout inf", "status --realm", "status --realm ../x", "topic echo pose -n 0",
    "param set a", "param set a 1 2", "param set a.x=1 b.x=2", "cage sideways", "goto 1_0 2 1",
    "fleet list --connect garbage", "fleet hold --vehicle uav",
]  # fmt: skip


@pytest.mark.parametrize("line", WRONG)
def test_a_line_that_cannot_be_parsed_is_exit_2(quadctl: Quadctl, line: str):
    result = quadctl(*line.split())
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith("error: ")
    assert "Traceback" not in result.err
    as_json = quadctl(*line.split(), "--json") if not line.endswith("--realm") else None
    if as_json is not None:
        assert (as_json.code, as_json.out) == (2, "")
        assert as_json.error["code"] == "usage"
        assert as_json.error["message"]


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "10001", "-1e300"])
def test_a_coordinate_out_of_range_is_exit_6(quadctl: Quadctl, number: str):
    for place in range(3):
        numbers = ["1", "1", "1"]
        numbers[place] = number
        result = quadctl("goto", *numbers, "--json")
        assert (result.code, result.error["code"]) == (6, "invalid")


def test_negative_numbers_are_not_options(quadctl: Quadctl):
    assert quadctl("goto", -1, -2.5, "-1e-3").code == 3
    assert quadctl("param", "set", "safety.takeoff", -1).code == 3
    assert quadctl("service", "call", "goto", -1, -2, 1).code == 3
