"""Exact output of commands: the lab's own forms, and each kind of failure."""

import os
import shlex
import signal
import subprocess
from collections.abc import Iterator

import pytest
import zenoh

from tests.support.bare import pack
from tests.support.command_transcripts import DROPPED, FOREIGN, HELD, TRANSCRIPTS
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually


@pytest.fixture(scope="module")
def module_lab() -> Iterator[Lab]:
    """Running system on the ground, with the lab's cage; frozen processes are not killed."""
    with private_lab() as made:
        made.start(
            "--set", "supervise.answer_timeout=60", "--set", "safety.takeoff=0",
            "--set", "safety.virtual_cage.z=2",
        )  # fmt: skip
        yield made


def test_commands_print_the_recorded_transcripts(module_lab: Lab):
    with module_lab.bare() as bare:
        held: list[zenoh.Query] = []
        servers = [
            bare.session.declare_queryable(DROPPED, zenoh.Query.drop, complete=True),
            bare.session.declare_queryable(HELD, held.append, complete=True),
        ]
        done = module_lab.each(TRANSCRIPTS)
        for server in servers:
            server.undeclare()
        for query in held:
            query.drop()
    assert dict(done) == TRANSCRIPTS


def foreign(query: zenoh.Query) -> None:
    with query:
        said = "application/msgpack;quadctl.GetParamsResponse#deadbeef"
        query.reply(query.key_expr, pack({"values": {}}), encoding=said)


def test_a_reply_of_another_version_is_refused(module_lab: Lab):
    with module_lab.bare() as bare:
        server = bare.session.declare_queryable(FOREIGN, foreign, complete=True)
        done = module_lab.quadctl("service", "call", "foreign/get_params", "names=[]")
        server.undeclare()
    what, hint = done.err.splitlines()
    assert done.code == 6
    assert what.startswith(
        "error: schema mismatch: the sender has GetParamsResponse#deadbeef, this side has "
    )
    assert hint == "  try: install the same version of quadctl on both sides"


def test_a_second_up_names_the_holder_of_the_realm(module_lab: Lab):
    pid = module_lab.status()["pid"]
    done = module_lab.quadctl("up", "-d")
    assert done == (
        7,
        "",
        (
            f"error: the realm {module_lab.realm} is already held by process {pid}\n"
            f"  try: `quadctl down --realm {module_lab.realm}` ends it; another --realm runs beside it\n"
        ),
    )


def test_status_shows_uptime_and_memory(module_lab: Lab):
    head, titles, *rows = module_lab.quadctl("status").out.splitlines()
    assert (
        head
        == f"realm {module_lab.realm}, vehicle uav, supervised by process {module_lab.status()['pid']}"
    )
    assert titles.split() == ["NAME", "STATE", "PID", "RESTARTS", "UPTIME", "MEMORY"]
    for row, node in zip(rows, module_lab.status()["nodes"], strict=True):
        name, state, pid, restarts, *_, amount, unit = row.split()
        assert (name, state, pid, restarts) == (node["name"], "ready", str(node["pid"]), "0")
        assert int(amount) > 5
        assert unit == "MB"


@pytest.mark.thorough
def test_errors_of_a_frozen_node_point_to_status(module_lab: Lab):
    pid = module_lab.signal("safety", signal.SIGSTOP)
    try:
        done = module_lab.each(
            ["hold", "goto 1 2 1", "state", "param get safety.takeoff"], "--timeout=1"
        )
    finally:
        os.kill(pid, signal.SIGCONT)
    for ended in done.values():
        # Both at first, while the node is silent, and after the hub has dropped it.
        assert ended.code == 4
        assert "`quadctl status`" in ended.err
    eventually(lambda: module_lab.quadctl("hold").code == 0)


def test_a_frozen_hub_is_not_reported_as_no_system(module_lab: Lab):
    pid = module_lab.signal("hub", signal.SIGSTOP)
    try:
        done = module_lab.quadctl("state", "--timeout", 0.4)
    finally:
        os.kill(pid, signal.SIGCONT)
    assert done == (
        4,
        "",
        (
            f"error: the realm {module_lab.realm} is up, but its hub did not answer within 0.4 s\n"
            "  try: its process is frozen or busy: it is restarted by itself, or with"
            " `quadctl node restart hub`\n"
        ),
    )
    eventually(lambda: module_lab.quadctl("state").code == 0)


def test_a_listing_has_one_item_per_line_on_a_narrow_terminal(module_lab: Lab):
    grep = "quadctl service list | grep pressure; quadctl topic list --json | wc -l"
    done = subprocess.run(
        ["sh", "-c", grep.replace("quadctl", shlex.join(module_lab.command()))],
        env=module_lab.environment | {"COLUMNS": "20"},
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


def test_commands_without_a_run_name_the_next_step(lab: Lab):
    # QUADCTL_REALM names the lab's realm, so the hint need not; another realm is named.
    up = "  try: `quadctl up -d` starts it\n"
    other = lab.quadctl("status", "--realm", "other").err
    assert other.endswith("  try: `quadctl up -d --realm other` starts it\n")
    for line in ("state", "down", "status", "service list", "service call uav/@srv/x"):
        done = lab.quadctl(*line.split())
        assert done == (3, "", f"error: nothing is running in the realm {lab.realm}\n{up}")


def test_a_service_of_another_vehicle_is_reported_as_unserved(module_lab: Lab):
    done = module_lab.quadctl("service", "info", "goto", "--vehicle", "other")
    assert done == (
        3,
        "",
        (
            "error: no node serves other/@srv/goto now: this run has no vehicle other\n"
            "  try: it has uav\n"
        ),
    )
