"""Bad messages from a third party: services answer, nothing changes, no process ends."""

import itertools
import math
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.support.bare import Bare, pack
from tests.support.lab import Lab
from tests.support.running import eventually

KEYS = ("pose", "sensors/pressure", "safety/state")
JUNK = (b"junk", b"", b"\xc1" * 30, pack({"stamp": 1.0}))
FOREIGN = "application/msgpack;quadctl.Pose#ffffffff"


@contextmanager
def garbage(bare: Bare, vehicle: str) -> Iterator[None]:
    """Publish unreadable messages until the block ends."""
    stop = threading.Event()

    def send() -> None:
        # At a node's normal rate at most: a flood would stop a flight, by design.
        for name, payload in itertools.cycle(itertools.product(KEYS, JUNK)):
            if stop.wait(0.005):
                return
            bare.session.put(f"{vehicle}/{name}", payload)
            if payload == JUNK[0]:
                bare.session.put(f"{vehicle}/pose", JUNK[-1], encoding=FOREIGN)
                bare.session.put(f"{vehicle}/**", b"for all")

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        stop.set()
        sender.join()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "line", ["goto 1 -1 1", "calibrate", "state", "state --json", "goto -1 0.5 1 --replace"]
)
def test_a_command_skips_unreadable_messages(shared_lab: Lab, hover: Bare, line: str):
    with garbage(hover, "uav"):
        done = shared_lab.quadctl(*line.split(), "--timeout", 10)
    assert done == (0, done.out, "")


@pytest.mark.thorough
def test_echo_reports_each_kind_of_bad_message_once_and_goes_on(shared_lab: Lab, bare: Bare):
    with garbage(bare, "uav"):
        done = shared_lab.quadctl("topic", "echo", "pose", "-n", 100, "--json", "--timeout", 10)
    assert done.code == 0
    assert len([row["seq"] for row in done.rows]) == 100
    said = done.err.splitlines()
    assert all(line.startswith("skipped a message on uav/pose: ") for line in said)
    assert len(said) == 2, "one line per kind: not a Pose, and a Pose of another version"
    assert any("schema mismatch" in line for line in said)


def test_control_characters_of_a_message_are_printed_escaped(shared_lab: Lab, bare: Bare):
    echo = shared_lab.spawn(*shared_lab.command("topic", "echo", "own/text", "-n", 1))

    def is_shown() -> bool:
        bare.put("uav/own/text", {"text": "\x1b[31mred\u202eder"})
        return echo.ended

    eventually(is_shown)
    assert echo.wait() == 0, echo.log
    assert "\\x1b[31mred\\u202eder" in echo.log
    assert "\x1b" not in echo.log


@pytest.mark.thorough
def test_a_timeout_error_names_the_unreadable_message(shared_lab: Lab, bare: Bare):
    lines = ["topic echo pose", "topic echo pose -n 1 --json"]
    with garbage(bare, "drone"):
        done = shared_lab.each(lines, "--vehicle", "drone", "--timeout", "0.5")
    for ended in done.values():
        assert (ended.code, ended.out) == (6, "")
        assert "no readable message came within 0.5 s: drone/pose: " in ended.err


def reply_with(query: zenoh.Query, payload: bytes) -> None:
    with query:
        query.reply(query.key_expr, payload)


@pytest.mark.thorough
def test_an_invalid_third_party_reply_does_not_hide_the_state(shared_lab: Lab, bare: Bare):
    server = bare.session.declare_queryable(
        "uav/safety/state", lambda query: reply_with(query, b"junk"), complete=True
    )
    for _ in range(3):
        done = shared_lab.quadctl("cage", "show", "--json")
        assert (done.code, done.json["on"]) == (0, True)
    server.undeclare()
    only_server = bare.session.declare_queryable(
        "drone/safety/state", lambda query: reply_with(query, b"junk"), complete=True
    )
    said = shared_lab.quadctl("cage", "show", "--vehicle", "drone", "--timeout", 0.3, "--json")
    assert (said.code, said.error["code"]) == (6, "invalid")
    assert "drone/safety/state: not a valid SafetyState" in said.error["message"]
    only_server.undeclare()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ('state = "HOVERING"', 'state = "HOVERNG"', "Invalid enum value 'HOVERNG' - at `$.state`"),
        ("count, state, goal,", "count, state, (1, 2, 1),", "Expected `object`, got `array`"),
    ],
    ids=["misspelt state", "tuple for a goal"],
)
def test_a_state_that_cannot_be_read_is_named_as_the_cause(
    lab: Lab, right: str, wrong: str, said: str
):
    example = Path(__file__).parents[2] / "examples" / "my_safety.py"
    text = example.read_text(encoding="utf-8")
    assert text.count(right) == 1
    (lab.folder / "mine.py").write_text(text.replace(right, wrong), encoding="utf-8")
    lab.start(lab.file('[processes]\nsafety = "python mine.py"\n'), "--set", "dynamics.start.z=1")
    flown = lab.quadctl("goto", 0.4, 0, 1, "--json", "--timeout", 1)
    assert (flown.code, flown.json["accepted"], flown.json["arrived"]) == (6, True, False)
    assert said in flown.error["message"]
    assert flown.error["message"].startswith("uav/safety/state: not a valid SafetyState: ")
    checks = {check["name"]: check for check in lab.quadctl("doctor", "--json").json["checks"]}
    assert checks["messages"]["verdict"] == "FAIL"
    assert f"uav/safety/state: not a valid SafetyState: {said}" in checks["messages"]["evidence"]


ERROR = "application/json;quadctl.Error"
BAD: dict[str, list[Any]] = {
    "goto": [
        *({"x": bad, "y": 0.0, "z": 1.0} for bad in (math.nan, math.inf, -math.inf, 1e300, 10_001)),
        {"x": 1.0, "y": math.nan, "z": 1.0},
        {"x": 1.0, "y": 0.0},
        {},
        {"x": "1", "y": 0.0, "z": 1.0},
        {"x": 1.0, "y": 0.0, "z": 1.0, "speed": 2.0},
        {"x": 1.0, "y": 0.0, "z": 1.0, "replace": "yes"},
        [1.0, 0.0, 1.0],
        None,
    ],
    "calibrate_pressure": [{}, {"zero": 1}, {"zero": "true"}, {"zero": True, "more": 1}, True],
    "toggle_cage": [{}, {"cage_on": 0}, {"cage_on": None}, {"cage_on": False, "more": 1}, [False]],
    "hold": [{"now": True}, [], None, 7],
    "reset": [{"now": True}, [], None, 7],
    "safety/get_params": [{}, {"names": "safety"}, {"names": [1]}, {"names": ["safety.nonsense"]}],
    "safety/set_params": [{}, {"values": []}, {"values": {1: 2}}],
    "pressure/set_params": [{}, {"values": 1}],
    "dynamics/set_params": [{}, {"values": None}],
    "hub/get_params": [{"names": {}}, 3],
}


def snapshot(bare: Bare) -> Any:
    """Return the state that a bad call must not change."""
    reading = bare.watch("uav/sensors/pressure").next()[0]
    pose = bare.watch("uav/pose").next()[0]
    state = {**bare.state(), "stamp": 0}
    return state, reading["baseline"], pose["boot"], bare.call("safety/get_params", names=[]).value


def pids(lab: Lab) -> dict[str, int]:
    return {name: node["pid"] for name, node in lab.nodes().items()}


@pytest.mark.parametrize("service", BAD)
def test_an_impossible_request_is_invalid_and_changes_nothing(hover: Bare, service: str):
    before = snapshot(hover)
    for value in BAD[service]:
        answer = hover.query(f"uav/@srv/{service}", pack(value))
        assert (answer.ok, answer.encoding) == (False, ERROR), value
        assert answer.code == "invalid", value
        assert answer.value["message"]
    assert snapshot(hover) == before


def test_random_bytes_on_every_service_change_nothing(shared_lab: Lab, hover: Bare):
    before, running = snapshot(hover), pids(shared_lab)
    rng = random.Random(1)
    valid = {
        "x": 1.0,
        "y": 0.0,
        "z": 1.0,
        "zero": True,
        "cage_on": False,
        "names": [],
        "values": {},
    }
    for service in BAD:
        for number in range(40):
            junk = bytearray(rng.randbytes(rng.randrange(60)))
            if number % 2:
                junk = bytearray(pack(valid))
                junk[rng.randrange(len(junk))] ^= 1 << rng.randrange(8)
            answer = hover.query(f"uav/@srv/{service}", bytes(junk))
            assert (answer.code, answer.encoding) == ("invalid", ERROR), (service, bytes(junk))
    assert snapshot(hover) == before
    assert pids(shared_lab) == running
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]
    assert hover.call("calibrate_pressure", zero=True).ok


def test_random_bytes_on_every_topic_end_no_process(shared_lab: Lab, hover: Bare):
    running, rng = pids(shared_lab), random.Random(2)
    keys = ["pose", "sensors/pressure", "safety/state", "input/position_request", "input/position"]
    for key in [*keys, "info", "anything"]:
        for _ in range(100):
            hover.session.put(f"uav/{key}", rng.randbytes(rng.randrange(60)))
    for node in ("safety", "dynamics", "pressure"):
        assert hover.call(f"{node}/get_params", names=[]).ok
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]
    assert pids(shared_lab) == running


def test_poses_with_nan_and_infinity_do_not_reach_safety(hover: Bare):
    pose = hover.watch("uav/pose").next()[0]
    for bad in (math.nan, math.inf, 1e300):
        forged = {**pose, "position": {"x": bad, "y": 0.0, "z": 1.0}}
        hover.put("uav/pose", forged)
    state = hover.state()
    assert state["boot"] == pose["boot"]
    assert all(math.isfinite(part) for part in state["goal"].values())
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]


def test_parameters_out_of_bounds_change_nothing(hover: Bare):
    before = snapshot(hover)
    for name, value in {
        "virtual_cage.x": math.nan,
        "virtual_cage.y": 0.0,
        "acceptance_range": math.inf,
        "cage_on": "yes",
        "nonsense": 1.0,
        "pose_timeout": [1],
    }.items():
        values = {"safety.virtual_cage.z": 3.0, f"safety.{name}": value}
        reply = hover.call("safety/set_params", values=values)
        assert reply.ok
        assert reply.value["success"] is False
        assert name.partition(".")[0] in reply.value["reason"]
    assert snapshot(hover) == before


@pytest.mark.parametrize("opening", [b"\x91", b"\x81\xa1a"], ids=["lists", "tables"])
@pytest.mark.parametrize("levels", [300, 900, 9900, 100_000])
def test_nested_values_end_no_process_and_change_nothing(
    shared_lab: Lab, hover: Bare, opening: bytes, levels: int
):
    """Send values of a depth that some Pythons read and others do not."""
    before, running = snapshot(hover), pids(shared_lab)
    values = b"\x81\xa6values\x81\xa6safety\x81\xa7takeoff" + opening * levels + b"\x01"
    answer = hover.query("uav/@srv/safety/set_params", values)
    refused = answer.ok and answer.value["success"] is False
    assert refused or answer.code == "invalid"
    assert pids(shared_lab) == running
    assert snapshot(hover) == before
