"""Who may talk to the console's server."""

import socket

import pytest

from quadctl.cli.console.console import bound, urls
from quadctl.cli.console.server import may_control, why_refused
from quadctl.services.runtime.errors import AlreadyServed, UsageError


@pytest.mark.parametrize("host", ["127.0.0.1:8470", "localhost:8470", "[::1]:8470", "127.0.0.1"])
def test_this_machines_own_names_are_served(host):
    assert why_refused(host, "", beyond=False) == ""
    assert why_refused(host, f"http://{host}", beyond=False) == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example:8470", "192.168.1.7:8470", "", "localhost.evil.example", "127.0.0.1.evil"],
)
def test_a_name_that_is_made_to_point_here_is_not(host):
    assert "127.0.0.1" in why_refused(host, "", beyond=False)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:9999", "http://localhost:8470", "null"]
)
def test_another_sites_page_is_not(origin):
    assert origin in why_refused("127.0.0.1:8470", origin, beyond=False)


def test_other_machines_are_allowed_by_address_and_host_name():
    name = socket.gethostname().lower()
    for host in ("192.168.1.7:8470", f"{name}:8470"):
        assert why_refused(host, "", beyond=True) == ""
    assert why_refused("evil.example:8470", "", beyond=True)


def test_the_token_alone_controls():
    assert may_control("abc", "abc")
    assert not any(may_control("abc", given) for given in ("", "ab", "abcd", "ABC", "\xe4"))


def test_a_taken_port_is_told_or_another_is_found():
    with bound("127.0.0.1", 0, exactly=True) as first:
        port = first.getsockname()[1]
        with pytest.raises(AlreadyServed, match=str(port)):
            bound("127.0.0.1", port, exactly=True)
        with bound("127.0.0.1", port, exactly=False) as second:
            assert second.getsockname()[1] not in {port, 0}


def test_no_such_port():
    with pytest.raises(UsageError):
        bound("127.0.0.1", 70_000, exactly=True)


def test_the_addresses_are_such_as_a_browser_takes():
    with bound("127.0.0.1", 0, exactly=True) as listening:
        port = listening.getsockname()[1]
        assert urls(listening, "abc") == (
            f"http://127.0.0.1:{port}/?token=abc",
            f"http://127.0.0.1:{port}/",
        )
