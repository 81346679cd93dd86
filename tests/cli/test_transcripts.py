"""What commands say to a student, word for word: the lab's own forms, and each way of failing."""

import os
import shlex
import signal
import subprocess
from collections.abc import Iterator

import pytest
import zenoh

from tests.support.bare import pack
from tests.support.command_transcripts import DROPPED, FOREIGN, HELD, SAID
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually


@pytest.fixture(scope="module")
def room() -> Iterator[Lab]:
    """A running system on the ground, with the lab's cage, that leaves frozen processes alone."""
    with private_lab() as made:
        made.start(
            "--set", "supervise.answer_timeout=60", "--set", "safety.takeoff=0",
            "--set", "safety.virtual_cage.z=2",
        )  # fmt: skip
        yield made


def test_word_for_word(room: Lab):
    with room.bare() as bare:
        held: list[zenoh.Query] = []
        servers = [
            bare.session.declare_queryable(DROPPED, zenoh.Query.drop, complete=True),
            bare.session.declare_queryable(HELD, held.append, complete=True),
        ]
        done = room.each(SAID)
        for server in servers:
            server.undeclare()
        for query in held:
            query.drop()
    assert dict(done) == SAID


def foreign(query: zenoh.Query) -> None:
    with query:
        said = "application/msgpack;quadctl.GetParamsResponse#deadbeef"
        query.reply(query.key_expr, pack({"values": {}}), encoding=said)


def test_another_versions_reply_is_told_from_ours(room: Lab):
    with room.bare() as bare:
        server = bare.session.declare_queryable(FOREIGN, foreign, complete=True)
        done = room.quadctl("service", "call", "foreign/get_params", "names=[]")
        server.undeclare()
    what, hint = done.err.splitlines()
    assert done.code == 6
    assert what.startswith(
        "error: schema mismatch: the sender has GetParamsResponse#deadbeef, this side has "
    )
    assert hint == "  try: install the same version of quadctl on both sides"


def test_a_second_up_is_told_who_holds_the_realm(room: Lab):
    pid = room.status()["pid"]
    done = room.quadctl("up", "-d")
    assert done == (
        7,
        "",
        (
            f"error: the realm {room.realm} is already held by process {pid}\n"
            f"  try: `quadctl down --realm {room.realm}` ends it; another --realm runs beside it\n"
        ),
    )


def test_status_tells_how_long_and_how_much(room: Lab):
    head, titles, *rows = room.quadctl("status").out.splitlines()
    assert head == f"realm {room.realm}, vehicle uav, supervised by process {room.status()['pid']}"
    assert titles.split() == ["NAME", "STATE", "PID", "RESTARTS", "UPTIME", "MEMORY"]
    for row, node in zip(rows, room.status()["nodes"], strict=True):
        name, state, pid, restarts, *_, amount, unit = row.split()
        assert (name, state, pid, restarts) == (node["name"], "ready", str(node["pid"]), "0")
        assert int(amount) > 5
        assert unit == "MB"


def test_who_is_frozen_is_looked_for_in_the_status(room: Lab):
    pid = room.signal("safety", signal.SIGSTOP)
    try:
        done = room.each(["hold", "goto 1 2 1", "state", "param get safety.takeoff"], "--timeout=1")
    finally:
        os.kill(pid, signal.SIGCONT)
    for ended in done.values():
        # Both at first, when it is there and silent, and when the hub has lost it.
        assert ended.code == 4
        assert "`quadctl status`" in ended.err
    eventually(lambda: room.quadctl("hold").code == 0)


def test_a_frozen_hub_is_not_taken_for_no_system(room: Lab):
    pid = room.signal("hub", signal.SIGSTOP)
    try:
        done = room.quadctl("state", "--timeout", 0.4)
    finally:
        os.kill(pid, signal.SIGCONT)
    assert done == (
        4,
        "",
        (
            f"error: the realm {room.realm} is up, but its hub did not answer within 0.4 s\n"
            "  try: its process is frozen or busy: it is restarted by itself, or with"
            " `quadctl node restart hub`\n"
        ),
    )
    eventually(lambda: room.quadctl("state").code == 0)


def test_a_listing_is_an_item_a_line_however_narrow_the_terminal(room: Lab):
    grep = "quadctl service list | grep pressure; quadctl topic list --json | wc -l"
    done = subprocess.run(
        ["sh", "-c", grep.replace("quadctl", shlex.join(room.command()))],
        env=room.environment | {"COLUMNS": "20"},
        capture_output=True,
        text=True,
        check=True,
    )
    *services, count = done.stdout.splitlines()
    assert [line.split() for line in services] == [
        ["calibrate_pressure", "Calibrate", "pressure"],
        ["pressure/get_params", "GetParams", "pressure"],
        ["pressure/set_params", "SetParams", "pressure"],
    ]
    assert count.strip() == "1"


def test_where_nothing_runs_the_next_step_is_told(lab: Lab):
    up = f"  try: `quadctl up --realm {lab.realm}` starts it\n"
    for line in ("state", "down", "status", "service list", "service call uav/@srv/x"):
        done = lab.quadctl(*line.split())
        assert done == (3, "", f"error: nothing is running in the realm {lab.realm}\n{up}")


def test_nobody_serves_another_vehicle(room: Lab):
    done = room.quadctl("service", "info", "goto", "--vehicle", "other")
    assert done == (
        3,
        "",
        (
            "error: no node serves other/@srv/goto now: this run has no vehicle other\n"
            "  try: it has uav\n"
        ),
    )
