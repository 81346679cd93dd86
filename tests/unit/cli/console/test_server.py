"""Access to the console's server by host, origin and token."""

import socket

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.console.console import listening_socket, urls
from quadctl.cli.console.server import may_control, refusal_reason
from quadctl.services.runtime.errors import AlreadyServed, UsageError

OURS = "127.0.0.1:8470"


def reason_for(
    host: str, origin: str = "", site: str = "", dest: str = "", *, beyond: bool = False
) -> str:
    """Return the reason to refuse a request; a header that is empty is not sent."""
    names = (b"host", b"origin", b"sec-fetch-site", b"sec-fetch-dest")
    sent = dict(zip(names, (host, origin, site, dest), strict=True))
    return refusal_reason({n: value for n, value in sent.items() if value}, beyond=beyond)


@pytest.mark.parametrize("host", ["127.0.0.1:8470", "localhost:8470", "[::1]:8470", "127.0.0.1"])
def test_requests_for_this_machines_own_names_are_served(host):
    assert reason_for(host) == ""
    assert reason_for(host, f"http://{host}") == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example:8470", "192.168.1.7:8470", "", "localhost.evil.example", "127.0.0.1.evil"],
)
def test_a_foreign_name_that_resolves_here_is_refused(host):
    assert "127.0.0.1" in reason_for(host)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:9999", "http://localhost:8470", "null"]
)
def test_a_page_of_another_site_is_refused(origin):
    assert origin in reason_for("127.0.0.1:8470", origin)


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_site_may_link_to_the_console_but_not_embed_it(site):
    assert reason_for(OURS, site=site, dest="document") == ""
    for dest in ("image", "iframe", "script", "style", "empty", "object", ""):
        assert "embed" in reason_for(OURS, site=site, dest=dest)


@pytest.mark.parametrize("site", ["none", "same-origin"])
def test_what_is_typed_or_its_own_is_served(site):
    for dest in ("document", "script", "style", "image", "empty"):
        assert reason_for(OURS, site=site, dest=dest) == ""


@pytest.mark.parametrize("bad", ["[::1", "::1]", "[1]", "[", "a]b", "[::g]:1"])
def test_a_malformed_host_or_origin_is_refused(bad):
    assert reason_for(bad)
    assert reason_for(OURS, f"http://{bad}")


@given(st.text(), st.text())
def test_any_host_and_origin_are_served_or_refused(host, origin):
    reason_for(host, origin)
    assert reason_for(OURS, origin or "x")


def test_other_machines_may_use_the_address_or_host_name():
    name = socket.gethostname().lower()
    for host in ("192.168.1.7:8470", f"{name}:8470"):
        assert reason_for(host, beyond=True) == ""
    assert reason_for("evil.example:8470", beyond=True)


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
