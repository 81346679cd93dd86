"""Exact output of commands: the lab's own forms, and each kind of failure."""

import shlex
import subprocess

import zenoh

from tests.support.bare import Bare, pack
from tests.support.lab import Lab

CALIBRATE = "bool zero\n---\nfloat64 baseline\n"
GOTO = "float64 x\nfloat64 y\nfloat64 z\nbool replace\nbool direct\nbool wait\n---\nbool accepted\nstring reason\n"
OUTSIDE = "error: outside the cage: x = 9 is beyond [-5, 5]\n"
SAY_MORE = "  try: `quadctl cage show` and `quadctl state` show more\n"
DROPPED, HELD = "uav/@srv/dropping/call", "uav/@srv/holding/call"
FOREIGN = "uav/@srv/foreign/get_params"

TRANSCRIPTS = {
    "service info /calibrate_pressure": (
        0,
        (
            "Node:   pressure\n"
            "Key:    uav/@srv/calibrate_pressure\n"
            "Type:   Calibrate\n"
            f"About:  Zero the barometer here.\n{CALIBRATE}"
        ),
        "",
    ),
    "service info goto": (
        0,
        f"Node:   safety\nKey:    uav/@srv/goto\nType:   Goto\nAbout:  Fly to a verified point.\n{GOTO}",
        "",
    ),
    "param get safety.virtual_cage.x": (0, "5.0\n", ""),
    "param get /safety/virtual_cage": (
        0,
        "safety.virtual_cage.x: 5.0\nsafety.virtual_cage.y: 5.0\nsafety.virtual_cage.z: 5.0\n",
        "",
    ),
    "calibrate --unset": (0, "baseline: 0.0000 hPa\n", ""),
    "service call /calibrate_pressure False": (0, "baseline: 0.0\n", ""),
    "service call toggle_cage cage_on=true": (0, "success: True\n", ""),
    "goto 9 0 1": (5, "rejected\n", OUTSIDE + SAY_MORE),
    "goto 9 0 1 --json": (
        5,
        (
            '{"accepted":false,"reason":"outside the cage: x = 9 is beyond [-5, 5]","arrived":false,'
            '"distance":null,"seconds":null}\n'
        ),
        (
            '{"error":{"code":"refused","message":"outside the cage: x = 9 is beyond [-5, 5]",'
            '"hint":"`quadctl cage show` and `quadctl state` show more"}}\n'
        ),
    ),
    "service call goto 9 0 1": (
        5,
        "accepted: False\nreason: 'outside the cage: x = 9 is beyond [-5, 5]'\n",
        OUTSIDE + SAY_MORE,
    ),
    "service info pressure/get_parms": (
        6,
        "",
        "error: there is no service pressure/get_parms\n  try: did you mean pressure/get_params?\n",
    ),
    f"service call {DROPPED} a=1": (
        3,
        "",
        (
            f"error: the server of {DROPPED} ended the call without an answer: the outcome is unknown\n"
            "  try: its handler may have failed: see the log of its process\n"
        ),
    ),
    "service call uav/@srv/nobody --timeout 1": (
        3,
        "",
        (
            "error: nobody served uav/@srv/nobody within 1 s\n"
            "  try: its process is down or does not offer it, or this identity may not call it:"
            " `quadctl status`, `quadctl service list`\n"
        ),
    ),
    f"service call {HELD} --timeout 0.5": (
        4,
        "",
        (
            f"error: {HELD} did not answer within 0.5 s\n"
            "  try: its process is busy or frozen: `quadctl status` shows which\n"
        ),
    ),
}
"""Exit code, stdout and stderr of commands, by the typed line."""


def test_commands_print_the_recorded_transcripts(shared_lab: Lab, hover: Bare):
    held: list[zenoh.Query] = []
    servers = [
        hover.session.declare_queryable(DROPPED, zenoh.Query.drop, complete=True),
        hover.session.declare_queryable(HELD, held.append, complete=True),
    ]
    done = shared_lab.each(TRANSCRIPTS)
    for server in servers:
        server.undeclare()
    for query in held:
        query.drop()
    assert dict(done) == TRANSCRIPTS


def foreign(query: zenoh.Query) -> None:
    with query:
        said = "application/msgpack;quadctl.GetParamsResponse#deadbeef"
        query.reply(query.key_expr, pack({"values": {}}), encoding=said)


def test_a_reply_of_another_version_is_refused(shared_lab: Lab, bare: Bare):
    server = bare.session.declare_queryable(FOREIGN, foreign, complete=True)
    done = shared_lab.quadctl("service", "call", "foreign/get_params", "names=[]")
    server.undeclare()
    what, hint = done.err.splitlines()
    assert done.code == 6
    assert what.startswith(
        "error: schema mismatch: the sender has GetParamsResponse#deadbeef, this side has "
    )
    assert hint == "  try: install the same version of quadctl on both sides"


def test_a_second_up_names_the_holder_of_the_realm(shared_lab: Lab):
    before = shared_lab.status()
    said = (
        f"error: the realm {shared_lab.realm} is already held by process {before['pid']}\n"
        f"  try: `quadctl down --realm {shared_lab.realm}` ends it; another --realm runs beside it\n"
    )
    assert {*shared_lab.each(["up", "up -d"]).values()} == {(7, "", said)}
    assert shared_lab.status() == before


def test_status_shows_uptime_and_memory(shared_lab: Lab):
    document = shared_lab.quadctl("ps", "--json").json
    assert document == shared_lab.status() | {"faults": [], "unproven": []}
    head, titles, *rows = shared_lab.quadctl("status").out.splitlines()
    assert (
        head
        == f"realm {shared_lab.realm}, vehicle uav, supervised by process {shared_lab.status()['pid']}"
    )
    assert titles.split() == ["NAME", "STATE", "PID", "RESTARTS", "UPTIME", "MEMORY"]
    for row, node in zip(rows, shared_lab.status()["nodes"], strict=True):
        name, state, pid, restarts, *_, amount, unit = row.split()
        assert (name, state) == (node["name"], "ready")
        assert (pid, restarts) == (str(node["pid"]), str(node["restarts"]))
        assert int(amount) > 5
        assert unit == "MB"


def test_a_listing_has_one_item_per_line_on_a_narrow_terminal(shared_lab: Lab):
    grep = "quadctl service list | grep pressure; quadctl topic list --json | wc -l"
    done = subprocess.run(
        ["sh", "-c", grep.replace("quadctl", shlex.join(shared_lab.command()))],
        env=shared_lab.environment | {"COLUMNS": "20"},
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
    assert lab.is_gone()


def test_a_service_of_another_vehicle_is_reported_as_unserved(shared_lab: Lab):
    done = shared_lab.quadctl("service", "info", "goto", "--vehicle", "other")
    assert done == (
        3,
        "",
        (
            "error: no node serves other/@srv/goto now: this run has no vehicle other\n"
            "  try: it has uav\n"
        ),
    )
