"""`bridge foxglove` with wrong options, and without its extra."""

import socket

import pytest

from tests.support import bridges
from tests.support.lab import Lab


@pytest.mark.thorough
def test_a_wrong_or_taken_port_is_refused_before_the_bridge_starts(lab: Lab):
    lab.start()
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        for port, code, what in (
            (0, 2, "--port 0: there is no such port"),
            (70000, 2, "--port 70000: there is no such port"),
            (taken, 1, f"port {taken} cannot be opened: Address already in use"),
        ):
            done = lab.quadctl("bridge", "foxglove", "--port", port)
            assert (done.code, done.out) == (code, "")
            assert done.err.startswith(f"error: {what}"), done.err
    lab.file("no certificate", "cert.pem")
    for words, code, what in (
        ("--host lab", 2, "--host lab: not an IP address"),
        ("--host 0.0.0.0", 2, "--host 0.0.0.0 lets other machines watch"),
        ("--key key.pem", 2, "--key without --cert"),
        ("--cert none.pem", 6, "--cert none.pem: No such file"),
        ("--cert cert.pem", 6, "--cert cert.pem: "),
    ):
        done = lab.quadctl("bridge", "foxglove", *words.split())
        assert (done.code, done.out) == (code, ""), done
        assert done.err.startswith(f"error: {what}"), done.err


def test_without_the_extra_the_command_says_what_to_install():
    found = bridges.without("websockets", "foxglove")
    assert found.returncode == 1
    assert "needs the package websockets" in found.stderr
    assert "pip install 'quadctl[foxglove]'" in found.stderr
