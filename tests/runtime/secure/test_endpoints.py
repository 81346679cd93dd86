"""What may be opened without encryption: this machine's own, and nothing else unless it is said."""

import pytest

from services.runtime.errors import UsageError
from services.runtime.secure.endpoints import is_secure, plain, refuse_open, secure

CLOSED = ["tcp/127.0.0.1:7447", "ws/localhost:1", "udp/[::1]:7447", "unixsock-stream//tmp/x"]
OPEN = ["tcp/0.0.0.0:7447", "udp/10.0.0.1:1", "ws/[::]:80", "tcp/teacher:7447", "tcp/127x.org:1",
        "tcp/localhost.evil.org:1", "tcp/[::1].evil:1"]  # fmt: skip


def test_tls_and_quic_are_the_gates():
    both = ["tls/0.0.0.0:1", *CLOSED, "quic/[::]:2"]
    assert secure(both) == ["tls/0.0.0.0:1", "quic/[::]:2"]
    assert plain(both) == CLOSED
    assert not is_secure("")


def test_this_machines_own_may_be_open():
    refuse_open([*CLOSED, "tls/0.0.0.0:7447"])


@pytest.mark.parametrize("endpoint", OPEN)
def test_others_are_refused(endpoint: str):
    with pytest.raises(UsageError, match="neither encrypted nor closed") as caught:
        refuse_open([*CLOSED, endpoint])
    assert "--insecure" in caught.value.hint
    assert f"tls/{endpoint.partition('/')[2]}" in caught.value.hint
