"""Access to the console's server by host, origin and token."""

import socket

import pytest

from quadctl.cli.console.console import listening_socket, urls
from quadctl.cli.console.server import may_control, refusal_reason
from quadctl.services.runtime.errors import AlreadyServed, UsageError


@pytest.mark.parametrize("host", ["127.0.0.1:8470", "localhost:8470", "[::1]:8470", "127.0.0.1"])
def test_requests_for_this_machines_own_names_are_served(host):
    assert refusal_reason(host, "", beyond=False) == ""
    assert refusal_reason(host, f"http://{host}", beyond=False) == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example:8470", "192.168.1.7:8470", "", "localhost.evil.example", "127.0.0.1.evil"],
)
def test_a_foreign_name_that_resolves_here_is_refused(host):
    assert "127.0.0.1" in refusal_reason(host, "", beyond=False)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:9999", "http://localhost:8470", "null"]
)
def test_a_page_of_another_site_is_refused(origin):
    assert origin in refusal_reason("127.0.0.1:8470", origin, beyond=False)


def test_other_machines_may_use_the_address_or_host_name():
    name = socket.gethostname().lower()
    for host in ("192.168.1.7:8470", f"{name}:8470"):
        assert refusal_reason(host, "", beyond=True) == ""
    assert refusal_reason("evil.example:8470", "", beyond=True)


def test_only_the_exact_token_may_control():
    assert may_control("abc", "abc")
    assert not any(may_control("abc", given) for given in ("", "ab", "abcd", "ABC", "\xe4"))


def test_a_taken_port_is_an_error_or_another_is_chosen():
    with listening_socket("127.0.0.1", 0, exactly=True) as first:
        port = first.getsockname()[1]
        with pytest.raises(AlreadyServed, match=str(port)):
            listening_socket("127.0.0.1", port, exactly=True)
        with listening_socket("127.0.0.1", port, exactly=False) as second:
            assert second.getsockname()[1] not in {port, 0}


def test_a_port_out_of_range_is_a_usage_error():
    with pytest.raises(UsageError):
        listening_socket("127.0.0.1", 70_000, exactly=True)


def test_the_printed_addresses_open_in_a_browser():
    with listening_socket("127.0.0.1", 0, exactly=True) as listening:
        port = listening.getsockname()[1]
        assert urls(listening, "abc") == (
            f"http://127.0.0.1:{port}/?token=abc",
            f"http://127.0.0.1:{port}/",
        )
