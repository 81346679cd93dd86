"""What a stranger sends on our keys that cannot be read: commands pass it over, and go on."""

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.processes.bare import Bare, pack
from tests.processes.lab import Lab

KEYS = ("pose", "sensors/pressure", "safety/state")
JUNK = (b"junk", b"", b"\xc1" * 30, pack({"stamp": 1.0}))
FOREIGN = "application/msgpack;quadctl.Pose#ffffffff"


@contextmanager
def nonsense(bare: Bare, vehicle: str) -> Iterator[None]:
    """A stranger who does not stop sending what nobody can read."""
    enough = threading.Event()

    def send() -> None:
        # Not more than a node's own rate: a flood of it would stop a flight, and rightly so.
        for name, payload in itertools.cycle(itertools.product(KEYS, JUNK)):
            if enough.wait(0.005):
                return
            bare.session.put(f"{vehicle}/{name}", payload)
            if payload == JUNK[0]:
                bare.session.put(f"{vehicle}/pose", JUNK[-1], encoding=FOREIGN)
                bare.session.put(f"{vehicle}/**", b"for all")

    stranger = threading.Thread(target=send)
    stranger.start()
    try:
        yield
    finally:
        enough.set()
        stranger.join()


@pytest.mark.parametrize(
    "line", ["goto 1 -1 1", "calibrate", "state", "state --json", "goto -1 0.5 1 --replace"]
)
def test_a_command_waits_for_what_can_be_read(shared_lab: Lab, hover: Bare, line: str):
    with nonsense(hover, "uav"):
        done = shared_lab.quadctl(*line.split(), "--timeout", 10)
    assert done == (0, done.out, "")


def test_echo_says_so_once_and_goes_on(shared_lab: Lab, bare: Bare):
    with nonsense(bare, "uav"):
        done = shared_lab.quadctl("topic", "echo", "pose", "-n", 100, "--json", "--timeout", 10)
    assert done.code == 0
    assert len([row["seq"] for row in done.rows]) == 100
    said = done.err.splitlines()
    assert all(line.startswith("passed over a message on uav/pose: ") for line in said)
    assert len(said) == 2, "one of a kind: no Pose at all, and one of another version"
    assert any("schema mismatch" in line for line in said)


def test_where_nothing_else_comes_the_error_says_what_came(shared_lab: Lab, bare: Bare):
    lines = ["topic echo pose", "topic echo pose -n 1 --json"]
    with nonsense(bare, "drone"):
        done = shared_lab.each(lines, "--vehicle", "drone", "--timeout", "0.5")
    for ended in done.values():
        assert (ended.code, ended.out) == (6, "")
        assert "nothing that can be read came within 0.5 s: drone/pose: " in ended.err


def reply_with(query: zenoh.Query, payload: bytes) -> None:
    with query:
        query.reply(query.key_expr, payload)


def test_a_strangers_reply_does_not_hide_the_state(shared_lab: Lab, bare: Bare):
    liar = bare.session.declare_queryable(
        "uav/safety/state", lambda query: reply_with(query, b"junk"), complete=True
    )
    for _ in range(3):
        done = shared_lab.quadctl("cage", "show", "--json")
        assert (done.code, done.json["on"]) == (0, True)
    liar.undeclare()
    alone = bare.session.declare_queryable(
        "drone/safety/state", lambda query: reply_with(query, b"junk"), complete=True
    )
    said = shared_lab.quadctl("cage", "show", "--vehicle", "drone", "--timeout", 0.3, "--json")
    assert (said.code, said.error["code"]) == (6, "invalid")
    assert "drone/safety/state: not a valid SafetyState" in said.error["message"]
    alone.undeclare()
