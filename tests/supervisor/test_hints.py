"""Hints are true: they name what the run offers and was not tried, and lead to the cause."""

import signal
from collections.abc import Iterator

import pytest

from tests.support.lab import Lab, private_lab
from tests.support.running import eventually

BUSY = """
from quadctl import start
from quadctl.schemas.messages import CageSize, Position, SafetyState
from quadctl.schemas.services import GotoResponse
from quadctl.schemas.topics import GOTO, STATE

def run(node, params):
    states = node.publisher(STATE)
    node.serve(GOTO, lambda ask: GotoResponse(False, "busy"))
    for pose in node.poses():
        home = Position(0.0, 0.0, 1.0)
        states.put(SafetyState(pose.boot, pose.stamp, 0, "MOVING", home, True, CageSize(5.0, 5.0, 2.0), ""))

start("safety", run)
"""
CRASHES = """
import os, pathlib, time
print("weighing", flush=True)
if not pathlib.Path("tried").exists():
    pathlib.Path("tried").touch()
    while os.getppid() and not pathlib.Path("now").exists():
        time.sleep(0.05)
    1 / 0
time.sleep(9999)
"""
COMMANDS = "[processes]\nsafety = 'python busy.py'\nscale = 'python scale.py'\n"


@pytest.fixture(scope="module")
def students() -> Iterator[Lab]:
    """Run of a student: a safety node that serves one service, and a process that crashes once."""
    with private_lab() as lab:
        (lab.folder / "busy.py").write_text(BUSY, encoding="utf-8")
        (lab.folder / "scale.py").write_text(CRASHES, encoding="utf-8")
        lab.start(lab.file(COMMANDS))
        yield lab


def test_a_refusal_advises_only_what_is_served_and_was_not_tried(students: Lab):
    first = students.quadctl("goto", 1, 0, 1)
    assert (first.code, first.out) == (5, "rejected\n")
    assert first.err == "error: busy\n  try: `--replace` changes course\n"
    second = students.quadctl("goto", 1, 0, 1, "--replace")
    assert (second.code, second.out) == (5, "rejected\n")
    wait = "`quadctl state --watch` shows when the vehicle has arrived"
    assert second.err == f"error: busy\n  try: {wait}\n"
    assert "quadctl hold" not in students.quadctl("fleet", "goto", "uav=1,0,1").err


def test_doctor_and_the_log_of_a_process_show_why_it_ended(students: Lab):
    scale = students.nodes()["scale"]["pid"]
    (students.folder / "now").touch()
    students.revived("scale", scale)
    cause = ["ZeroDivisionError: division by zero", "scale ended (exit 1): restarting in"]
    log = students.quadctl("node", "logs", "scale").out
    assert all(line in log for line in cause), log
    checks = {c["name"]: c for c in students.quadctl("doctor", "--json").json["checks"]}
    assert checks["node scale"]["verdict"] == "WARN"
    assert "; ".join(cause) in checks["node scale"]["evidence"]


@pytest.mark.thorough
def test_doctor_and_the_log_of_a_frozen_process_show_that_it_was_killed(students: Lab):
    frozen = students.signal("dynamics", signal.SIGSTOP)
    students.revived("dynamics", frozen)
    killed = "dynamics: no answer for 2 s: killed"
    assert killed in students.quadctl("node", "logs", "dynamics").out
    checks = {c["name"]: c for c in students.quadctl("doctor", "--json").json["checks"]}
    assert killed in checks["node dynamics"]["evidence"]


@pytest.mark.thorough
def test_a_fault_of_an_own_process_is_cleared_by_the_name_that_the_list_shows(students: Lab):
    assert students.quadctl("fault", "inject", "scale-frozen").out == "scale-frozen is in\n"
    assert "in  scale-frozen" in students.quadctl("fault", "list").out
    assert students.quadctl("fault", "clear", "scale-frozen").out == "scale-frozen is out\n"


@pytest.mark.thorough
def test_the_log_of_a_killed_process_shows_its_signal(students: Lab):
    killed = students.signal("pressure", signal.SIGKILL)
    students.revived("pressure", killed)
    eventually(
        lambda: "pressure ended (SIGKILL)" in students.quadctl("node", "logs", "pressure").out
    )
