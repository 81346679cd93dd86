"""`replay` publishes a recording again, to the byte, and only where that is safe."""

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from quadctl.services.runtime.recording.reader import Bag, Recorded
from tests.support.bags import flight, raw_message, write
from tests.support.bombs import BOMBS
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually

ONLY_A_HUB = ("--without", "dynamics", "--without", "pressure", "--without", "safety")


@pytest.fixture(scope="module")
def hub_only() -> Iterator[Lab]:
    """Realm with only a hub, and a recording of two seconds in its folder."""
    with private_lab() as made:
        made.start(*ONLY_A_HUB)
        write(made.folder / "flight.mcap", flight(200))
        yield made


def bus_messages(path: Path) -> list[Recorded]:
    return [message for message in Bag(path).messages() if not message.derived]


def test_a_replay_publishes_the_same_messages_to_the_byte(hub_only: Lab):
    first = bus_messages(hub_only.folder / "flight.mcap")
    run = hub_only.spawn(*hub_only.command("record", "-o", "again.mcap", "--json"))
    eventually(lambda: "recording" in run.log)
    done = hub_only.quadctl("replay", "flight.mcap", "--speed", 0, "--json")
    assert done.code == 0, done
    eventually(lambda: f'"messages":{len(first)},' in run.log)
    run.send(signal.SIGINT)
    assert run.wait() == 0
    again = bus_messages(hub_only.folder / "again.mcap")
    assert done.json["messages"] == len(first)
    assert [(m.key, m.payload, m.encoding) for m in again] == [
        (m.key, m.payload, m.encoding) for m in first
    ]


@pytest.mark.thorough
def test_a_replay_starts_at_from_and_keeps_the_speed(hub_only: Lab):
    began = time.monotonic()
    words = ("--from", 1.0, "--speed", 2, "--json")
    done = hub_only.quadctl("replay", "flight.mcap", *words)
    assert done.code == 0
    assert time.monotonic() - began > done.json["wall_seconds"] > 0.45
    assert done.json["seconds"] == pytest.approx(0.99)
    # One second: 100 poses, 10 readings and 10 third-party messages.
    assert done.json["messages"] == 120


@pytest.mark.thorough
def test_commands_see_the_recorded_system_during_a_replay(hub_only: Lab):
    run = hub_only.spawn(*hub_only.command("replay", "flight.mcap", "--speed", 0.02))
    eventually(lambda: "uav/pose" in hub_only.quadctl("topic", "list").out)
    listed = {row["key"]: row for row in hub_only.quadctl("topic", "list", "--json").json}
    assert {row["node"] for row in listed.values()} == {"replay"}
    assert listed["uav/pose"]["declared_hz"] == 100
    shown = hub_only.quadctl("topic", "echo", "pose", "-n", 1, "--json")
    assert shown.json["boot"] == "b0"
    assert hub_only.quadctl("state", "--json").json["cage"] == {"x": 5.0, "y": 5.0, "z": 2.0}
    second = hub_only.quadctl("replay", "flight.mcap", "--json")
    assert (second.code, second.error["code"]) == (7, "already_served")
    run.send(signal.SIGINT)
    assert run.wait() == 130
    assert hub_only.quadctl("topic", "list", "--json").json == []


@pytest.mark.thorough
def test_a_replay_reports_a_hub_that_dies(hub_only: Lab):
    run = hub_only.spawn(
        *hub_only.command("replay", "flight.mcap", "--speed", 0.02, "--timeout", 1)
    )
    eventually(lambda: "uav/pose" in hub_only.quadctl("topic", "list").out)
    hub_only.revived("hub", hub_only.signal("hub", signal.SIGKILL))
    assert run.wait() == 3, run.log
    assert "hub" in run.log


def test_a_replay_without_a_run_starts_its_own_hub(lab: Lab):
    write(lab.folder / "f.mcap", flight(20))
    done = lab.quadctl("replay", "f.mcap")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("replayed 25 messages of 4 keys")
    assert lab.is_gone()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGKILL])
def test_a_signal_ends_a_replay_with_its_own_hub(lab: Lab, number: int):
    write(lab.folder / "f.mcap", flight(20))
    run = lab.spawn(*lab.command("replay", "f.mcap", "--speed", 0.001))
    with lab.first_bare() as bare:
        eventually(lambda: "replay" in bare.nodes())
    run.send(number)
    assert run.wait() == (-number if number == signal.SIGKILL else 128 + number), run.log
    # After SIGKILL it cannot wait for the end of its hub.
    eventually(lab.is_gone)


@pytest.mark.thorough
def test_a_replay_beside_a_live_vehicle_is_refused(shared_lab: Lab):
    file = write(shared_lab.folder / "live.mcap", [raw_message("uav/mine", b"x", 0, "text/plain")])
    with shared_lab.bare() as bare:
        received = bare.watch("uav/mine")
        for words in ((), ("uav/mine",)):
            done = shared_lab.quadctl("replay", file, *words, "--json")
            assert (done.code, done.error["code"]) == (7, "already_served")
            assert "vehicle uav is live" in done.error["message"]
        assert received.messages == []


@pytest.mark.thorough
def test_recorded_poses_can_be_replayed_to_a_live_node(hub_only: Lab):
    """Replay recorded poses to a live safety, which publishes its own output."""
    with private_lab() as lab:
        lab.start("--without", "dynamics", "--without", "pressure")
        file = write(lab.folder / "f.mcap", flight(50))
        whole = lab.quadctl("replay", file, "--json")
        assert whole.error["message"].startswith("uav/safety/state is published by safety")
        assert lab.quadctl("replay", file, "pose", "--speed", 0).code == 0
        with lab.bare() as bare:
            eventually(lambda: bare.state()["boot"] == "b0")


@pytest.mark.thorough
def test_an_impossible_replay_is_refused_with_the_reason(hub_only: Lab):
    hub_only.file("no recording", "text.mcap")
    for words, code, text in (
        (("text.mcap",), 6, "text.mcap is not a recording"),
        (("missing.mcap",), 6, "missing.mcap cannot be read"),
        (("flight.mcap", "nobodys/own"), 6, "flight.mcap has nothing to replay"),
        (("flight.mcap", "--from", 99), 6, "flight.mcap has nothing to replay"),
        (("flight.mcap", "--speed", -1), 6, "--speed -1: no speed"),
    ):
        done = hub_only.quadctl("replay", *words, "--json")
        assert (done.code, text in done.error["message"]) == (code, True), done


def test_a_cut_recording_is_replayed_as_far_as_it_goes(hub_only: Lab):
    write(hub_only.folder / "cut.mcap", flight(100), whole=False)
    done = hub_only.quadctl("replay", "cut.mcap", "--speed", 0, "--json")
    assert done.code == 0
    assert json.loads(done.out)["cut"]
    assert "the recording is cut" in done.err


def test_a_recording_made_to_do_harm_is_not_replayed(hub_only: Lab):
    lines = {}
    for name in (
        "8 GiB by zstd",
        "torn JSON",
        "keys that are paths",
        "a key that is an expression",
    ):
        file = hub_only.folder / f"{name.replace(' ', '-')}.mcap"
        file.write_bytes(BOMBS[name]().data)
        lines[f"replay {file.name} --speed 0"] = 6
    done = hub_only.each(lines, "--json")
    assert {line: one.code for line, one in done.items()} == lines
    assert all(one.error["hint"] for one in done.values())
