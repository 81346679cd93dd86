"""Today's nodes answer a recorded client, and today's commands work with recorded nodes.

The recorded side is data, so this file does not import the product.
"""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.golden import data
from tests.golden.differences import differences
from tests.golden.traffic import Nodes, ask, shape
from tests.support.bare import Bare, unpack
from tests.support.lab import NODES, PATIENT, Lab, private_lab

RECORDED = data.read("traffic")
VOLATILE = ("payload",)
"""Fields of a reply with numbers and wording, which may change."""


@pytest.fixture(scope="module")
def current() -> Iterator[Bare]:
    """Bare session on a running system of the current version."""
    with private_lab() as lab:
        lab.start("--set", "dynamics.start.z=1", *PATIENT)
        with lab.bare() as bare:
            yield bare


def without_volatile(reply: dict[str, Any]) -> dict[str, Any]:
    return {name: part for name, part in reply.items() if name not in VOLATILE}


def test_a_recorded_client_is_answered_as_recorded(current: Bare):
    told = []
    for exchange in RECORDED["exchanges"]:
        found = ask(current, exchange)
        recorded = [without_volatile(reply) for reply in exchange["replies"]]
        told += differences(
            recorded, [without_volatile(reply) for reply in found], exchange["name"]
        )
        if exchange["attachment"]:
            assert ask(current, exchange) == found, "a repeated id gets the first reply again"
    assert not told, "\n".join(told)


@pytest.mark.parametrize("key", RECORDED["topics"])
def test_a_recorded_subscriber_reads_the_topics(current: Bare, key: str):
    recorded = RECORDED["topics"][key]
    watch = current.watch(key)
    latched = key in {"uav/info", "uav/safety/zones"}
    message = current.latest(key) if latched else watch.next()[-1]
    assert list(message) == list(read(recorded))
    if not latched:
        assert shape(message).keys() == shape(read(recorded)).keys()
        assert watch.encodings[-1] == recorded["encoding"]


def read(sent: dict[str, Any]) -> Any:
    return unpack(bytes.fromhex(sent["payload"]))


@pytest.fixture(scope="module")
def recorded_nodes() -> Iterator[tuple[Lab, Nodes]]:
    """Hub of the current version with the recorded nodes on it."""
    with private_lab() as lab:
        lab.start(*(f"--without={node}" for node in NODES if node != "hub"))
        with lab.bare() as bare, Nodes(bare, RECORDED) as nodes:
            yield lab, nodes


def test_todays_commands_read_recorded_nodes(recorded_nodes: tuple[Lab, Nodes]):
    lab, nodes = recorded_nodes
    topics = RECORDED["topics"]
    done = lab.each(
        [
            "state",
            "topic echo pose -n 1",
            "topic echo sensors/pressure -n 1",
            "topic echo safety/state -n 1",
            "topic echo input/position -n 1",
            "topic echo info -n 1",
            "cage show",
            "topic list",
            "service list",
            "node list",
            "topic info pose",
        ],
        "--json",
    )
    assert {line: (ended.code, ended.err) for line, ended in done.items()} == dict.fromkeys(
        done, (0, "")
    )
    state, pose = read(topics["uav/safety/state"]), read(topics["uav/pose"])
    assert done["state"].json == state | {"pose": pose}
    for line, ended in done.items():
        if line.startswith("topic echo"):
            assert ended.json == read(topics[f"uav/{line.split()[2]}"]), line
    assert done["cage show"].json["on"] == state["cage_on"]
    offers = [token.split("/") for token in RECORDED["tokens"]]
    for kinds, command in (({"@pub", "@sub"}, "topic list"), ({"@srv"}, "service list")):
        told = {offer[-1].replace("%", "/") for offer in offers if kinds & set(offer)}
        assert {row["key"] for row in done[command].json} == told
    assert [row["name"] for row in done["node list"].json] == NODES
    assert nodes.unrecorded == []


def test_todays_commands_control_recorded_nodes(recorded_nodes: tuple[Lab, Nodes]):
    lab, nodes = recorded_nodes
    lines = {
        "calibrate": "calibrate",
        "calibrate --unset": "calibrate --unset",
        "cage off": "cage off",
        "cage on": "cage on",
        "goto outside": "goto 9 0 1 --replace --no-wait",
        "goto --replace": "goto 0.25 0 1 --replace --no-wait",
        "hold": "hold",
        "param set": "param set safety.acceptance_range 0.4",
        "reset": "reset",
    }
    nodes.asked.clear()
    done = {name: lab.quadctl(*line.split(), "--json") for name, line in lines.items()}
    codes = {name: ended.code for name, ended in done.items()}
    assert nodes.unrecorded == []
    assert codes == dict.fromkeys(lines, 0) | {"goto outside": 5}
    assert nodes.asked == list(lines)
    baseline = read(RECORDED["topics"]["uav/sensors/pressure"])["baseline"]
    assert done["calibrate"].json["baseline"] == baseline


def test_todays_goto_follows_a_recorded_flight(recorded_nodes: tuple[Lab, Nodes]):
    lab, nodes = recorded_nodes
    nodes.asked.clear()
    flown = lab.quadctl("goto", 0.5, 0, 1, "--json")
    assert nodes.unrecorded == []
    assert (flown.code, flown.err) == (0, "")
    assert (flown.json["accepted"], flown.json["arrived"]) == (True, True)
    assert nodes.asked == ["goto", "param get of dynamics"]
