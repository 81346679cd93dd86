"""`bridge mavlink` and `autopilot` with wrong options, and without their extra."""

import json
import signal
import sys

import pytest

from tests.support import bridges
from tests.support.lab import Lab
from tests.support.running import eventually


@pytest.mark.thorough
def test_wrong_options_are_refused_before_the_bridge_starts(lab: Lab):
    lab.start()
    lab.file("", "empty.key")
    for words, code, what in (
        ("--to tcp:127.0.0.1:1", 2, "--to tcp:127.0.0.1:1: not an address"),
        ("--to udpout:127.0.0.1:0", 2, "--to udpout:127.0.0.1:0: not an address"),
        ("--to udpout:127.0.0.1", 2, "--to udpout:127.0.0.1: not an address"),
        ("--to udpout:192.0.2.1:14550", 2, "--to udpout:192.0.2.1:14550 is on the network"),
        ("--to udpout:no.such.host.invalid:1", 2, "--to udpout:no.such.host.invalid:1: "),
        ("--origin 91 0 0", 2, "--origin: latitude 91"),
        ("--origin 0 181 0", 2, "--origin: longitude 181"),
        ("--origin 0 0 nan", 2, "--origin: altitude nan"),
        ("--origin 1 2", 2, "Option '--origin' requires 3 arguments"),
        ("--signing-key none.key", 6, "--signing-key none.key: No such file"),
        ("--signing-key empty.key", 6, "--signing-key empty.key is empty"),
    ):
        done = lab.quadctl("bridge", "mavlink", *words.split())
        assert (done.code, done.out) == (code, ""), done
        assert done.err.startswith(f"error: {what}"), done.err


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


def test_without_the_extra_the_command_says_what_to_install():
    found = bridges.without("pymavlink", "mavlink")
    assert found.returncode == 1
    assert "needs the package pymavlink" in found.stderr
    assert "pip install 'quadctl[mavlink]'" in found.stderr


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
