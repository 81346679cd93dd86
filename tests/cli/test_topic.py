"""`topic pub|info|echo|hz|bw|delay` on a running system."""

import signal
import subprocess
from functools import partial
from typing import Any

import pytest

from tests.support.bare import Bare, pack, unpack
from tests.support.lab import Lab
from tests.support.running import Foreground, eventually

REQUEST = "uav/input/position_request"
Sample = tuple[bytes, str]


@pytest.fixture
def received(bare: Bare) -> list[Sample]:
    """Messages received on `my/**`."""
    found: list[Sample] = []
    kept: Any = bare.session.declare_subscriber(
        "my/**", lambda s: found.append((s.payload.to_bytes(), str(s.encoding)))
    )
    bare._declared.append(kept)
    bare.nodes()  # a round trip: now the hub has the declaration
    return found


@pytest.mark.parametrize(
    "words",
    [
        f"-1 /{REQUEST} geometry_msgs/Vector3 '{{x: 2, y: -1, z: 1}}'",
        "input/position_request x=2 y=-1 z=1 --once",
    ],
)
def test_a_waypoint_is_flown_in_both_spellings(shared_lab: Lab, hover: Bare, words: str):
    states, requests = hover.watch("uav/safety/state"), hover.watch(REQUEST)
    done = shared_lab.each([f"topic pub {words}"]).popitem()[1]
    assert done == (0, f"sent 1 message on {REQUEST}\n", "")
    taken = states.until(lambda s: s["state"] == "MOVING")
    assert taken["goal"] == {"x": 2.0, "y": -1.0, "z": 1.0}
    requests.until(lambda sent: sent == taken["goal"])
    assert requests.encodings[0].startswith("application/msgpack;quadctl.Waypoint#")


def test_pub_sends_any_payload_on_a_foreign_key(shared_lab: Lab, received: list[Sample]):
    sends = {
        "my/text hello": (b"hello", "text/plain"),
        "my/json a=1 b.c=true": (b'{"a":1,"b":{"c":true}}', "application/json"),
        "my/pack a=1 --as msgpack": (b"\x81\xa1a\x01", "application/msgpack"),
        "my/hex 00ff --as hex": (b"\x00\xff", "zenoh/bytes"),
    }
    for words in sends:
        assert shared_lab.quadctl("topic", "pub", *words.split()).code == 0
    eventually(lambda: len(received) == len(sends))
    assert received == list(sends.values())


def test_pub_sends_many_messages_at_a_rate(shared_lab: Lab, received: list[Sample]):
    done = shared_lab.quadctl("topic", "pub", "my/count", 7, "-r", 200, "-n", 20, "--json")
    assert done.json == {"key": "my/count", "sent": 20, "encoding": "text/plain"}
    eventually(lambda: len(received) == 20)
    endless = shared_lab.spawn(*shared_lab.command("topic", "pub", "-r", 50, "my/count", 8))
    eventually(lambda: (b"8", "text/plain") in received)
    endless.send(signal.SIGINT)
    assert endless.wait() == 130
    assert endless.log.startswith("sent ")


def test_pub_waits_for_a_listener(shared_lab: Lab, bare: Bare):
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


@pytest.mark.thorough
def test_pub_suggests_the_nearest_name_without_a_listener(shared_lab: Lab, bare: Bare):
    hints = {
        "topic pub sensors/pressur x=1": "did you mean uav/sensors/pressure?",
        "topic pub uav/input/position_reqest x=1 y=2 z=1": "did you mean uav/input/position_request?",
        "topic pub zzz x=1": "is it spelled right?",
    }
    done = shared_lab.each(hints, "--timeout", "1", "--json")
    assert {line: ended.error["hint"] for line, ended in done.items()} == {
        line: f"{hint} --no-wait sends anyway" for line, hint in hints.items()
    }
    assert {ended.code for ended in done.values()} == {3}


def test_pub_on_the_topic_of_a_lab_node_warns(shared_lab: Lab, bare: Bare):
    readings = bare.watch("uav/sensors/pressure")
    words = "sensors/pressure stamp=0 pressure=-7 baseline=0 samples=0 spread=0"
    done = shared_lab.quadctl("topic", "pub", *words.split(), "--json")
    assert done.code == 0
    assert done.err.startswith("warning: uav/sensors/pressure is pressure's own")
    assert readings.until(lambda reading: reading["pressure"] == -7)


@pytest.mark.thorough
def test_an_invalid_message_is_not_sent(shared_lab: Lab, bare: Bare):
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


SPREAD = ["min", "max", "std", "n"]


@pytest.mark.thorough
@pytest.mark.parametrize(("verb", "shown"), [("echo", "---"), ("hz", "average rate")])
def test_a_topic_that_falls_silent_suggests_no_other_name(
    shared_lab: Lab, bare: Bare, verb: str, shown: str
):
    run = shared_lab.spawn(*shared_lab.command("topic", verb, "uav/own/word", "--timeout", 2))

    def is_shown() -> bool:
        bare.put("uav/own/word", 1)
        return shown in run.log

    eventually(is_shown)
    assert run.wait() == 3
    assert "nothing more came on uav/own/word within 2 s" in run.log
    assert "did you mean" not in run.log


def test_topic_info_shows_type_publishers_and_listeners(shared_lab: Lab):
    said = shared_lab.quadctl("topic", "info", "/uav/pose", "--json").json
    assert said["publishers"] == ["dynamics"]
    assert (said["key"], said["type"], said["declared_hz"]) == ("uav/pose", "Pose", 100)
    assert said["listened"] is False, "safety subscribes to the slow poses"
    assert shared_lab.quadctl("topic", "info", "pose/slow", "--json").json["listened"] is True
    assert said["definition"].startswith("string boot\n")
    assert len(said["hash"]) == 8
    text = shared_lab.quadctl("topic", "info", "input/position_request")
    assert (text.code, text.err) == (0, "")
    assert "Publishers:   none that is announced\nSubscribers:  safety\n" in text.out
    assert "Listeners:    at least one\n" in text.out
    assert text.out.endswith("float64 x\nfloat64 y\nfloat64 z\n")


@pytest.mark.thorough
def test_topic_info_of_a_foreign_topic_and_of_an_unknown_one(shared_lab: Lab, bare: Bare):
    token = "uav/@node/eye/@pub/Image/00c0ffee/30/camera%image"
    kept = [bare.session.liveliness().declare_token(token)]
    said = shared_lab.quadctl("topic", "info", "camera/image", "--json").json
    assert said == {
        "key": "camera/image", "type": "Image", "hash": "00c0ffee", "declared_hz": 30.0,
        "publishers": ["eye"], "subscribers": [], "definition": "", "listened": False,
    }  # fmt: skip
    assert "not known" in shared_lab.quadctl("topic", "info", "camera/image").out
    done = shared_lab.each(
        [
            "topic info camera/imag",
            "topic info sensors/presure",
            "topic info zzz",
            "topic info pos",
        ],
        "--json",
    )
    assert {ended.code for ended in done.values()} == {3}
    hints = [ended.error["hint"] for ended in done.values()]
    assert hints[0] == "did you mean camera/image?"
    assert hints[1] == "did you mean sensors/pressure?" or hints[1].endswith(
        "uav/sensors/pressure?"
    )
    assert "topic list" in hints[2]
    assert hints[3] == "did you mean pose?"
    assert kept


@pytest.mark.thorough
def test_hz_bw_and_delay_print_their_figures(shared_lab: Lab):
    lines = [f"topic {verb} sensors/pressure -n 5" for verb in ("hz", "bw", "delay")]
    as_json = shared_lab.each(lines, "--json")
    documents = [ended.json for ended in as_json.values()]
    assert list(documents[0]) == ["key", "hz", *SPREAD]
    assert list(documents[1]) == ["key", "bytes_per_second", "mean", "min", "max", "n"]
    assert list(documents[2]) == ["key", "delay", *SPREAD]
    assert {(found["key"], found["n"]) for found in documents} == {("uav/sensors/pressure", 5)}
    assert 0 < documents[0]["min"] <= documents[0]["max"]
    assert documents[1]["mean"] == documents[1]["min"] > 20
    text = shared_lab.each([f"{line} --window 3" for line in lines])
    begins = [ended.out.partition(":")[0] for ended in text.values()]
    assert begins == ["average rate", "average", "average delay"]
    assert all(ended.out.endswith("window: 3\n") for ended in text.values())


@pytest.mark.thorough
def test_figures_are_printed_until_ctrl_c(shared_lab: Lab):
    watching = [
        shared_lab.spawn(*shared_lab.command("topic", *words.split()))
        for words in ("hz pose", "bw uav/** --json")
    ]
    for process in watching:
        eventually(partial(has_lines, process, 2))
        process.send(signal.SIGINT)
        assert process.wait() == 130
        assert "Traceback" not in process.log
    assert watching[0].log.startswith("average rate: ")
    assert watching[1].log.startswith('{"key":"uav/**","bytes_per_second":')


def has_lines(process: Foreground, count: int) -> bool:
    return len(process.log.splitlines()) >= count


@pytest.mark.thorough
def test_commands_on_a_silent_key_end_by_the_timeout(shared_lab: Lab):
    lines = {
        "topic hz no/thing": 3,
        "topic bw no/** -n 5": 3,
        "topic delay no/thing": 3,
        "topic echo no/**": 3,
        "topic echo uav/sensor/pressure": 3,
        # Announced and latched, but not published again.
        "topic bw */info": 4,
        "topic hz info": 4,
    }
    done = shared_lab.each(lines, "--timeout", "0.3", "--json")
    assert {line: ended.code for line, ended in done.items()} == lines
    assert {ended.out for ended in done.values()} == {""}
    assert "did you mean uav/sensors/pressure?" in done["topic echo uav/sensor/pressure"].err


def test_messages_of_a_key_expression_show_their_key(shared_lab: Lab):
    as_json = shared_lab.quadctl("topic", "echo", "**/pose", "-n", 2, "--json")
    assert [list(row) for row in as_json.rows] == 2 * [["key", "value"]]
    assert as_json.rows[0]["key"] == "uav/pose"
    assert set(as_json.rows[0]["value"]) >= {"boot", "position"}
    text = shared_lab.quadctl("topic", "echo", "uav/sens$*/*", "-n", 1).out.splitlines()
    assert text[0] == "key: uav/sensors/pressure"
    assert text[1].startswith("stamp: ")
    assert text[-1] == "---"
    # Messages without the field are passed over.
    field = shared_lab.quadctl("topic", "echo", "uav/**", "--field", "baseline", "-n", 2)
    assert field.code == 0
    assert field.out.splitlines()[::2] == ["key: uav/sensors/pressure"] * 2
    assert "skipped a message on uav/pose: the message has no field baseline" in field.err


@pytest.mark.thorough
def test_echo_accepts_once_and_field_as_in_ros(shared_lab: Lab, hover: Bare):
    lines = {
        "topic echo pose --once": "boot",
        "topic echo -1 /uav/pose": "boot",
        "topic echo pose -1 --field position/z": "1.0",
        "topic echo pose/position/z -1": "1.0",
        "topic echo /uav/pose/position -1 --field z": "1.0",
        "topic echo /uav/pose/position --once": "x",
    }
    done = shared_lab.each(lines)
    assert {line: ended.out[:4].partition(":")[0].rstrip() for line, ended in done.items()} == {
        line: begin[:4] for line, begin in lines.items()
    }
    wrong = shared_lab.quadctl("topic", "echo", "pose/position/q", "--json")
    assert (wrong.code, wrong.error["hint"]) == (6, "in position there is: x, y, z")
    assert shared_lab.quadctl("topic", "echo", "pose", "-1", "-n", 2).code == 2


def test_echo_that_was_stopped_says_so_and_goes_on(shared_lab: Lab):
    echo = shared_lab.spawn(
        *shared_lab.command("topic", "echo", "pose", "--field", "stamp", "--timeout", 0.5)
    )
    eventually(lambda: echo.log)
    echo.send(signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        echo.wait(2.0)  # longer than the timeout, and than the hub keeps a silent client
    echo.send(signal.SIGCONT)
    said = "this command was stopped: messages of that time may be missing\n"
    eventually(lambda: echo.log.partition(said)[2], describe=lambda: echo.log)
    echo.send(signal.SIGINT)
    assert echo.wait() == 130
    assert "error" not in echo.log


def test_a_users_topic_below_pose_is_not_read_as_a_field(shared_lab: Lab, bare: Bare):
    token = "uav/@node/eye/@pub/Point/00c0ffee/30/uav%pose%position"
    kept = [bare.session.liveliness().declare_token(token)]
    bare.nodes()  # a round trip: now the hub has the declaration
    silent = shared_lab.quadctl("topic", "echo", "uav/pose/position", "-1", "--timeout", 0.3)
    assert (silent.code, silent.out) == (4, "")
    assert "nothing came on uav/pose/position" in silent.err
    assert kept


@pytest.mark.parametrize(
    ("payload", "encoding", "words", "shown"),
    [
        (b'{"a": [1, {"b": 2}]}', "application/json", "--field a.1.b", "2\n"),
        (pack({"a": 1, 2: b"\xff"}), "application/msgpack", "--json", '{"a":1,"2":"ff"}\n'),
        (b"\xc7\x01\x05\x00", "application/msgpack", "--json", '{"ext":5,"data":"00"}\n'),
        (b"\xcb\x7f\xf8\0\0\0\0\0\0", "application/msgpack", "--json", '"nan"\n'),
        (b"hello", "text/plain", "--json", '"hello"\n'),
        (b"\xc1\x00", "zenoh/bytes", "", "c100\n---\n"),
    ],
)
def test_echo_shows_any_payload_of_a_foreign_program(
    shared_lab: Lab, bare: Bare, payload: bytes, encoding: str, words: str, shown: str
):
    line = shared_lab.command("topic", "echo", "my/own", "-n", 1, *words.split())
    listening = shared_lab.spawn(*line)

    def published_until_end() -> bool:
        bare.session.put("my/own", payload, encoding=encoding)
        return listening.ended

    eventually(published_until_end)
    assert (listening.wait(), listening.log) == (0, shown)


@pytest.mark.thorough
@pytest.mark.parametrize("words", ["topic echo pose", "state --watch --json", "topic hz pose"])
def test_a_closed_pipe_ends_a_command_quietly(shared_lab: Lab, words: str):
    process = subprocess.Popen(
        shared_lab.command(*words.split()),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=shared_lab.environment,
        cwd=shared_lab.folder,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    with process:
        assert process.stdout.readline()
        process.stdout.close()
        if words.startswith("state"):
            shared_lab.quadctl("goto", 9, 9, 9, "--no-wait")
        assert process.wait() == 0
        assert process.stderr.read() == b""
