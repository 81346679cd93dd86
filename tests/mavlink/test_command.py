"""`bridge mavlink` with wrong options, and without its extra."""

import json
import signal

from tests.support import bridges
from tests.support.lab import Lab
from tests.support.running import eventually


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
