"""A live name is completed in the spelling that was begun, and only as it will be understood."""

import pytest

from quadctl.cli.completion import engine
from quadctl.cli.names import find_service, key_of
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.services.runtime.params.names import normal_name


def going_on(found, begun: str) -> list[str]:
    """As quadctl.cli.completion.engine leaves them."""
    return sorted(word for word in found if word.startswith(begun))


def served(key: str, type_: str = "Calibrate") -> EndpointInfo:
    return EndpointInfo("@srv", "somebody", type_, "00000000", 0, key)


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
def test_a_topic_of_ours(begun: str, words: list[str]):
    assert going_on(engine.topic("uav/pose", begun, "uav"), begun) == words


@pytest.mark.parametrize("key", ["uav/foo", "foo", "other/pose", "uav/camera/left"])
def test_a_topic_of_anybody_elses_is_offered_by_the_key_that_commands_take(key: str):
    assert going_on(engine.topic(key, "", "uav"), "") == [key]
    assert going_on(engine.topic(key, f"/{key[:2]}", "uav"), "/") == [f"/{key}"]


@pytest.mark.parametrize("begun", ["", "/", "u", "/u"])
def test_what_is_offered_for_a_topic_is_its_key(begun: str):
    for key in (*(topic.key("uav") for topic in TOPICS), "uav/foo", "foo"):
        assert {key_of(word, "uav") for word in engine.topic(key, begun, "uav")} == {key}


def test_of_several_vehicles_by_full_keys_alone():
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
def test_a_service_of_ours(begun: str, words: list[str]):
    offer = served("uav/@srv/calibrate_pressure")
    assert going_on(engine.service(offer, begun, "uav"), begun) == words


@pytest.mark.parametrize("begun", ["", "/", "u", "/u", "/uav/@"])
def test_what_is_offered_for_a_service_is_understood(begun: str):
    for known in SERVICES:
        for word in engine.service(served(known.key("uav")), begun, "uav"):
            assert find_service(word, "uav") is known
    get = served("uav/@srv/mine/get_params", "GetParams")
    for word in engine.service(get, begun, "uav"):
        assert find_service(word, "uav").name == "mine/get_params"


def test_a_service_of_ones_own():
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
def test_a_parameter(begun: str, words: list[str]):
    assert going_on(engine.parameter("safety.takeoff", begun, "uav"), begun) == words


@pytest.mark.parametrize(("begun", "word"), [("", "safety.takeoff"), ("/s", "/safety/takeoff")])
def test_a_setting(begun: str, word: str):
    assert [*engine.setting("safety.takeoff", begun)] == [word]
    assert normal_name(word) == "safety.takeoff"


@pytest.mark.parametrize(
    ("begun", "words"),
    [("saf", ["safety"]), ("/saf", ["/safety"]), ("/", ["/safety"]), ("/uav/", ["/uav/safety"])],
)
def test_a_node(begun: str, words: list[str]):
    assert going_on(engine.node("safety", begun, "uav"), begun) == words
