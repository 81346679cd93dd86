"""`bridge mavlink` and `autopilot` with wrong options, and without their extra."""

import json
import signal
import sys

import pytest

from tests.support.lab import Lab
from tests.support.running import eventually


@pytest.mark.thorough
def test_its_address_is_printed(lab: Lab):
    lab.start()
    process = lab.spawn(
        *lab.command("bridge", "mavlink", "--origin", "-33.9", "151.2", "20", "--json")
    )
    eventually(lambda: process.log.count("\n") > 1)
    assert json.loads(process.log.splitlines()[0]) == {
        "to": "udpout:127.0.0.1:14550", "vehicles": ["uav"],
    }  # fmt: skip
    process.send(signal.SIGINT)
    assert process.wait() in {0, 130}


@pytest.mark.thorough
def test_wrong_options_of_an_autopilot_are_refused(lab: Lab):
    origin = "--origin 47 8 400"
    for words, code, what in (
        ("", 2, "--origin is missing"),
        ("fly", 2, "autopilot fly: no such word"),
        ("--origin 91 0 0", 2, "--origin: latitude 91"),
        (f"--connect tcp:127.0.0.1:1 {origin}", 2, "--connect tcp:127.0.0.1:1: not an address"),
        (f"--connect udpin:0.0.0.0:14540 {origin}", 2, "--connect udpin:0.0.0.0:14540 is on the"),
        (f"--signing-key none.key {origin}", 6, "--signing-key none.key: No such file"),
        ("calibrate --distance 0", 6, "--distance 0: not a distance"),
        ("calibrate", 3, "nothing is running in the realm"),
    ):
        done = lab.quadctl("autopilot", *words.split())
        assert (done.code, done.out) == (code, ""), done
        assert done.err.startswith(f"error: {what}"), done.err


@pytest.mark.thorough
def test_an_autopilot_flies_in_real_time_alone(lab: Lab):
    command = f"{sys.executable} -m quadctl autopilot --origin 47 8 400"
    file = lab.file(f"[processes]\ndynamics = {json.dumps(command)}\n[dynamics]\nspeed = 0\n")
    done = lab.quadctl("up", "-d", file)
    assert done.code != 0
    assert "an autopilot flies in real time" in lab.taken_logs()["dynamics.log"]
