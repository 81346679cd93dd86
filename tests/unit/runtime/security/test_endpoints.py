"""Endpoints: only local ones may be opened without encryption unless `--insecure` is given."""

import pytest

from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security.endpoints import (
    check,
    how_to_open,
    is_secure,
    plain,
    refuse_open,
    secure,
)

CLOSED = ["tcp/127.0.0.1:7447", "ws/localhost:1", "udp/[::1]:7447", "unixsock-stream//tmp/x"]
OPEN = ["tcp/0.0.0.0:7447", "udp/10.0.0.1:1", "ws/[::]:80", "tcp/teacher:7447", "tcp/127x.org:1",
        "tcp/localhost.evil.org:1", "tcp/[::1].evil:1"]  # fmt: skip


def test_tls_and_quic_endpoints_are_secure():
    both = ["tls/0.0.0.0:1", *CLOSED, "quic/[::]:2"]
    assert secure(both) == ["tls/0.0.0.0:1", "quic/[::]:2"]
    assert plain(both) == CLOSED
    assert not is_secure("")


def test_local_endpoints_may_be_unencrypted():
    refuse_open([*CLOSED, "tls/0.0.0.0:7447"])


@pytest.mark.parametrize("endpoint", OPEN)
def test_other_unencrypted_endpoints_are_refused(endpoint: str):
    with pytest.raises(UsageError, match="neither encrypted nor local") as caught:
        refuse_open([*CLOSED, endpoint])
    assert "--insecure" in caught.value.hint
    assert f"tls/{endpoint.partition('/')[2]}" in caught.value.hint


@pytest.mark.parametrize("endpoint", [*CLOSED, *OPEN, "tls/lab2:7447", "quic/[::]:2#iface=eth0"])
def test_valid_endpoints_are_accepted(endpoint: str):
    check(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    ["garbage", "", "lab2:7447", "tcp:lab2:7447", "tcp/lab2", "tls/lab2:", "tls/:7447", "tls/a:port",
     "http/lab2:80", "http://lab2:80", "tcp//lab2:7447", "unixsock-stream/", "TLS/lab2:7447"],
)  # fmt: skip
def test_an_invalid_endpoint_is_refused_with_the_right_form(endpoint: str):
    with pytest.raises(UsageError, match="is not an endpoint") as caught:
        check(endpoint)
    assert "PROTOCOL/ADDRESS" in caught.value.hint


def test_the_hint_for_a_remote_hub_names_the_command_there():
    assert "on that machine: `quadctl up --listen tls/0.0.0.0:7447`" in how_to_open("tls/lab2:7447")
    assert "--listen udp/0.0.0.0:1`" in how_to_open("udp/[::1]:1#iface=lo")
    assert "socket" in how_to_open("unixsock-stream//tmp/x")
