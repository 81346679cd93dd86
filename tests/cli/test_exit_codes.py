"""No command hangs, and each way of failing has its exit code."""

import os
import signal
from collections.abc import Iterator
from functools import partial

import pytest
import zenoh

from tests.support.bare import Bare, pack
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually

NEEDS_A_RUN = [
    "status", "ps", "down", "state", "hold", "reset", "calibrate", "cage on", "cage off",
    "cage show", "goto 1 2 1", "topic list", "topic echo pose", "service list",
    "service info goto", "service call calibrate_pressure zero=true", "param list",
    "param get safety.cage_on", "param set safety.takeoff 1", "node list", "record", "plot --live",
    "fleet list", "fleet hold", "fleet land-all", "fleet goto 0 0 1",
    "bridge foxglove", "bridge mavlink", "bridge ros2",
]  # fmt: skip

FAILS = {
    "goto nan 0 1": 6,
    "goto 0 inf 1": 6,
    "goto 0 0 10001": 6,
    "goto abc 0 1": 2,
    "goto 1 2": 2,
    "goto 1_0 2 1": 2,
    "goto 1 2 1 --arrive 0": 6,
    "flee": 2,
    "fleet goto 1 2": 2,
    "fleet goto uav=1,2": 2,
    "fleet goto line": 6,
    "fleet goto drone=1,2,1": 6,
    "fleet goto nan 0 1": 6,
    "fleet goto 1e400 0 1": 6,
    "fleet goto uav=0,0,1 uav=1,0,1": 2,
    "fleet list --fleet /dev/full": 6,
    "fleet list --connect garbage": 2,
    "fleet list --connect tcp/127.0.0.1:1": 3,
    "fleet hold --vehicle uav": 2,
    "fleet hold --fleet none.toml": 6,
    "cage sideways": 2,
    "state --timeout 0": 2,
    "state --realm no/name": 2,
    "topic echo pose -n 1 --field position.q": 6,
    "service call calibrate zero=true": 6,
    "service call calibrate_pressure zero=7": 6,
    "service call calibrate_pressure zero=true more=1": 6,
    "param get safety.acceptance_rang": 6,
    "param get nonsense": 6,
    "param set safety.takeoff": 2,
    "param set safety.takeoff=1 pressure.rate=5": 2,
    "topic echo no/such/thing -n 1 --timeout 0.2": 3,
    "goto 9 0 1": 5,
    "service call goto x=9 y=0 z=1": 5,
}


def test_every_command_exits_3_when_nothing_runs(lab: Lab):
    done = lab.each(NEEDS_A_RUN, "--json")
    assert {line: ended.code for line, ended in done.items()} == dict.fromkeys(NEEDS_A_RUN, 3)
    assert {ended.error["code"] for ended in done.values()} == {"unreachable"}
    assert {ended.out for ended in done.values()} == {""}
    assert lab.is_gone()
    as_text = lab.quadctl("state")
    what, hint = as_text.err.splitlines()
    assert what.startswith("error: ")
    assert hint.startswith("  try: ")
    assert "quadctl up" in hint


def test_impossible_commands_fail_with_their_exit_codes(shared_lab: Lab, hover: Bare):
    before = hover.state()
    done = shared_lab.each(FAILS, "--json")
    assert {line: ended.code for line, ended in done.items()} == FAILS
    for line, ended in done.items():
        assert set(ended.error) == {"code", "message", "hint"}, line
        assert "Traceback" not in ended.err
        assert ended.out == "" or ended.code == 5, line
    after = hover.state()
    assert after["request"] == before["request"] + list(FAILS.values()).count(5)
    assert after["goal"] == before["goal"]


@pytest.fixture(scope="module")
def patient_lab() -> Iterator[Lab]:
    """Lab with a supervisor that does not kill frozen processes."""
    with private_lab() as made:
        made.start("--set", "supervise.answer_timeout=60", "--set", "safety.takeoff=0")
        yield made


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("node", "lines"),
    [
        ("safety", ["goto 1 2 1", "hold", "state", "cage show", "cage on",
                    "param get safety.takeoff", "param set safety.takeoff 1"]),
        ("pressure", ["calibrate", "topic echo sensors/pressure -n 1",
                      "service call calibrate_pressure True"]),
        ("dynamics", ["reset", "topic echo pose -n 1", "state"]),
        ("hub", ["goto 1 2 1", "state", "calibrate", "topic echo pose -n 1", "topic list"]),
    ],
)  # fmt: skip
def test_a_frozen_node_ends_a_command_by_its_timeout(patient_lab: Lab, node: str, lines: list[str]):
    pid = patient_lab.signal(node, signal.SIGSTOP)
    try:
        done = patient_lab.each(lines, "--timeout", "0.5", "--json")
        codes = {line: ended.code for line, ended in done.items()}
        assert codes == dict.fromkeys(lines, 4)
        assert patient_lab.quadctl("status").code == 0
    finally:
        os.kill(pid, signal.SIGCONT)
    with patient_lab.bare() as bare:
        for thawed in ("safety", "pressure", "dynamics"):
            key = f"uav/@srv/{thawed}/get_params"
            assert eventually(partial(bare.answers, key, pack({"names": []})))[0].ok
        assert bare.state()["request"] == 0, "no call is executed after its deadline"


def test_a_missing_server_is_exit_3_and_a_silent_one_exit_4(lab: Lab):
    lab.start("--without", "safety")
    assert list(lab.nodes()) == ["hub", "dynamics", "pressure"]
    assert lab.quadctl("calibrate").code == 0
    nobody = lab.quadctl("goto", 1, 2, 1, "--timeout", 0.3, "--json")
    assert (nobody.code, nobody.error["code"]) == (3, "unreachable")
    held: list[zenoh.Query] = []
    with lab.bare() as bare:
        keys = [f"uav/@srv/{name}" for name in ("goto", "hold", "toggle_cage")]
        servers = [
            bare.session.declare_queryable(key, held.append, complete=True)
            for key in [*keys, "uav/safety/state"]
        ]
        lines = ["goto 1 2 1", "hold", "cage on", "cage show", "state", "service call hold"]
        done = lab.each(lines, "--timeout", "0.5", "--json")
        assert {line: ended.code for line, ended in done.items()} == dict.fromkeys(lines, 4)
        assert {ended.error["code"] for ended in done.values()} == {"timeout"}
        assert len(held) >= len(lines)
        for server in servers:
            server.undeclare()
        for query in held:
            query.drop()
