"""Transport without Unix sockets: loopback TCP on a free port, with a password."""

import json

import pytest
import zenoh

from tests.support.bare import Bare
from tests.support.lab import Lab


@pytest.mark.thorough
def test_loopback_tcp_flies_and_rejects_a_wrong_password(lab: Lab):
    lab.start("--set", "hub.transport=tcp")
    assert not (lab.home / "hub.sock").exists()
    assert lab.home.stat().st_mode & 0o077 == 0
    flown = lab.quadctl("goto", 1, 2, 1, "--json")
    assert (flown.code, flown.json["arrived"]) == (0, True)
    assert lab.quadctl("calibrate").code == 0

    address = json.loads((lab.home / "hub.json").read_bytes())
    assert address["endpoint"].startswith("tcp/127.0.0.1:")
    for user, password in (("", ""), (address["user"], "guess"), ("guess", address["password"])):
        with pytest.raises(zenoh.ZError):
            Bare(address["endpoint"], user, password)
    with Bare(address["endpoint"], address["user"], address["password"]) as known:
        assert known.state()["goal"] == {"x": 1.0, "y": 2.0, "z": 1.0}
