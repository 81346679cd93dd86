"""Start of the bridges: wrong options, missing extras, and beside a run."""

import socket

import pytest

from tests.support import bridges
from tests.support.lab import Lab

WRONG = (
    ("foxglove --port 0", 2, "--port 0: there is no such port"),
    ("foxglove --port 70000", 2, "--port 70000: there is no such port"),
    ("foxglove --host lab", 2, "--host lab: not an IP address"),
    ("foxglove --host 0.0.0.0", 2, "--host 0.0.0.0 lets other machines watch"),
    ("foxglove --key key.pem", 2, "--key without --cert"),
    ("foxglove --cert none.pem", 6, "--cert none.pem: No such file"),
    ("foxglove --cert empty", 6, "--cert empty: "),
    ("mavlink --to tcp:127.0.0.1:1", 2, "--to tcp:127.0.0.1:1: not an address"),
    ("mavlink --to udpout:127.0.0.1:0", 2, "--to udpout:127.0.0.1:0: not an address"),
    ("mavlink --to udpout:127.0.0.1", 2, "--to udpout:127.0.0.1: not an address"),
    ("mavlink --to udpout:192.0.2.1:1", 2, "--to udpout:192.0.2.1:1 is on the network"),
    ("mavlink --to udpout:no.such.host.invalid:1", 2, "--to udpout:no.such.host.invalid:1: "),
    ("mavlink --origin 91 0 0", 2, "--origin: latitude 91"),
    ("mavlink --origin 0 181 0", 2, "--origin: longitude 181"),
    ("mavlink --origin 0 0 nan", 2, "--origin: altitude nan"),
    ("mavlink --origin 1 2", 2, "Option '--origin' requires 3 arguments"),
    ("mavlink --signing-key none", 6, "--signing-key none: No such file"),
    ("mavlink --signing-key empty", 6, "--signing-key empty is empty"),
    ("ros2 --domain 233", 2, "--domain 233: there is no such domain"),
    ("ros2 --router localhost", 2, "'localhost' is not an endpoint"),
)


@pytest.mark.thorough
def test_wrong_options_are_refused_before_a_bridge_starts(lab: Lab):
    lab.start()
    lab.file("", "empty")
    expected = {f"bridge {line}": (code, what) for line, code, what in WRONG}
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        taken = f"port {port} cannot be opened: Address already in use"
        expected[f"bridge foxglove --port {port}"] = 1, taken
        found = lab.each(expected)
    for line, (code, what) in expected.items():
        assert (found[line].code, found[line].out) == (code, ""), found[line]
        assert found[line].err.startswith(f"error: {what}"), found[line]
    home = lab.quadctl("bridge", "ros2", ROS_DOMAIN_ID="home")
    assert home.err.startswith("error: ROS_DOMAIN_ID=home: there is no such domain")


@pytest.mark.parametrize(
    ("bridge", "package"),
    [("foxglove", "websockets"), ("mavlink", "pymavlink"), ("ros2", "rosbags")],
)
def test_without_the_extra_the_command_says_what_to_install(bridge: str, package: str):
    found = bridges.without(package, bridge)
    assert found.returncode == 1
    assert f"needs the package {package}" in found.stderr
    assert f"pip install 'quadctl[{bridge}]'" in found.stderr


def test_bridges_start_with_the_run(lab: Lab):
    lab.start("--bridge", "mavlink", "--bridge", "ros2")
    assert {"mavlink", "ros2"} <= lab.nodes().keys()
