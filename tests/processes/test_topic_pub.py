"""`topic pub`: what is sent arrives, and nothing is lost unsaid."""

import signal
from typing import Any

import pytest

from tests.processes.bare import Bare, unpack
from tests.processes.lab import Lab
from tests.processes.running import eventually

REQUEST = "uav/input/position_request"
Sample = tuple[bytes, str]


@pytest.fixture
def heard(bare: Bare) -> list[Sample]:
    """What comes on `my/**`."""
    found: list[Sample] = []
    kept: Any = bare.session.declare_subscriber(
        "my/**", lambda s: found.append((s.payload.to_bytes(), str(s.encoding)))
    )
    bare._declared.append(kept)
    bare.nodes()  # a round trip: the hub knows of it
    return found


@pytest.mark.parametrize(
    "words",
    [
        f"/{REQUEST} geometry_msgs/Vector3 '{{x: 2, y: -1, z: 1}}'",
        f"-1 {REQUEST} geometry_msgs/Vector3 2 -1 1",
        f"/{REQUEST} geometry_msgs/Vector3 '{{x: 2, y: -1, z: 1}}' -1",
        f"-1 /{REQUEST} 'x: 2\ny: -1\nz: 1'",
        "input/position_request x=2 y=-1 z=1 --once",
        """input/position_request '{"x": 2, "y": -1, "z": 1}'""",
    ],
)
def test_a_waypoint_is_flown_in_every_spelling(shared_lab: Lab, hover: Bare, words: str):
    states, requests = hover.watch("uav/safety/state"), hover.watch(REQUEST)
    done = shared_lab.each([f"topic pub {words}"]).popitem()[1]
    assert done == (0, f"sent 1 message on {REQUEST}\n", "")
    taken = states.until(lambda s: s["state"] == "MOVING")
    assert taken["goal"] == {"x": 2.0, "y": -1.0, "z": 1.0}
    requests.until(lambda sent: sent == taken["goal"])
    assert requests.encodings[0].startswith("application/msgpack;quadctl.Waypoint#")


def test_a_strange_key_gets_what_is_written(shared_lab: Lab, heard: list[Sample]):
    sends = {
        "my/text hello": (b"hello", "text/plain"),
        "my/json a=1 b.c=true": (b'{"a":1,"b":{"c":true}}', "application/json"),
        "my/pack a=1 --as msgpack": (b"\x81\xa1a\x01", "application/msgpack"),
        "my/hex 00ff --as hex": (b"\x00\xff", "zenoh/bytes"),
    }
    for words in sends:
        assert shared_lab.quadctl("topic", "pub", *words.split()).code == 0
    eventually(lambda: len(heard) == len(sends))
    assert heard == list(sends.values())


def test_many_messages_at_a_rate(shared_lab: Lab, heard: list[Sample]):
    done = shared_lab.quadctl("topic", "pub", "my/count", 7, "-r", 200, "-n", 20, "--json")
    assert done.json == {"key": "my/count", "sent": 20, "encoding": "text/plain"}
    eventually(lambda: len(heard) == 20)
    endless = shared_lab.spawn(*shared_lab.command("topic", "pub", "-r", 50, "my/count", 8))
    eventually(lambda: (b"8", "text/plain") in heard)
    endless.send(signal.SIGINT)
    assert endless.wait() == 130
    assert endless.log.startswith("sent ")


def test_it_waits_for_a_listener(shared_lab: Lab, bare: Bare):
    waiting = shared_lab.spawn(
        *shared_lab.command("topic", "pub", "late/key", "x", "--timeout", 20)
    )
    nobody = shared_lab.quadctl("topic", "pub", "late/other", "x", "--timeout", 0.2, "--json")
    assert (nobody.code, nobody.error["code"]) == (3, "unreachable")
    assert "--no-wait" in nobody.error["hint"]
    assert not waiting.ended
    found: list[bytes] = []
    kept = bare.session.declare_subscriber("late/key", lambda s: found.append(s.payload.to_bytes()))
    assert waiting.wait() == 0
    eventually(lambda: found == [b"x"])
    kept.undeclare()
    alone = shared_lab.quadctl("topic", "pub", "late/other", "x", "--no-wait")
    assert (alone.code, alone.out) == (0, "sent 1 message on late/other\n")


def test_the_nearest_name_is_told_where_nobody_listens(shared_lab: Lab, bare: Bare):
    hints = {
        "topic pub sensors/pressur x=1": "did you mean uav/sensors/pressure?",
        "topic pub uav/input/position_reqest x=1 y=2 z=1": "did you mean uav/input/position_request?",
        "topic pub zzz x=1": "is it spelled right?",
    }
    done = shared_lab.each(hints, "--timeout", "0.2", "--json")
    assert {line: ended.error["hint"] for line, ended in done.items()} == {
        line: f"{hint} --no-wait sends nevertheless" for line, hint in hints.items()
    }
    assert {ended.code for ended in done.values()} == {3}


def test_what_a_node_of_ours_publishes_is_sent_with_a_warning(shared_lab: Lab, bare: Bare):
    readings = bare.watch("uav/sensors/pressure")
    words = "sensors/pressure stamp=0 pressure=-7 baseline=0 samples=0 spread=0"
    done = shared_lab.quadctl("topic", "pub", *words.split(), "--json")
    assert done.code == 0
    assert done.err.startswith("warning: uav/sensors/pressure is pressure's own")
    assert readings.until(lambda reading: reading["pressure"] == -7)


def test_what_is_no_message_is_not_sent(shared_lab: Lab, bare: Bare):
    requests: list[bytes] = []
    kept = bare.session.declare_subscriber(
        REQUEST, lambda sample: requests.append(sample.payload.to_bytes())
    )
    bare.nodes()
    lines = {
        f"topic pub {REQUEST} x=1 y=2": 6,
        f"topic pub {REQUEST} 1 2 nan": 6,
        f"topic pub {REQUEST} 1 2 1e9": 6,
        f"topic pub {REQUEST} 'x: 1'": 6,
        f"topic pub {REQUEST} 1 2 1 --as json": 6,
        "topic pub a/b xyz --as hex": 6,
        "topic pub a/b 1 --as xml": 2,
        "topic pub a/b": 2,
        "topic pub a/b 1 -r 0": 6,
        "topic pub a/b 1 -r nan": 6,
        "topic pub a/b 1 --once -r 5": 2,
        "topic pub -1 a/b 1 -n 2": 2,
    }
    done = shared_lab.each(lines, "--json")
    assert {line: ended.code for line, ended in done.items()} == lines
    assert shared_lab.quadctl("topic", "pub", REQUEST, 1, 0, 1).code == 0
    eventually(lambda: requests)
    assert [unpack(request) for request in requests] == [{"x": 1.0, "y": 0.0, "z": 1.0}]
    kept.undeclare()
