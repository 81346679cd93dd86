"""Sessions of clients: none survives its client for long."""

from types import SimpleNamespace
from typing import Any

import pytest

from quadctl.services.runtime.bus import client
from quadctl.services.runtime.bus.client import Client


class Session:
    """Session that may have lost its hub."""

    def __init__(self) -> None:
        self.hubs, self.is_closed = ["hub"], False
        self.info: Any = SimpleNamespace(routers_zid=lambda: self.hubs)

    def close(self) -> None:
        """Close it."""
        self.is_closed = True


def test_a_client_without_its_hub_is_closed_once_another_one_is_connected(
    monkeypatch: pytest.MonkeyPatch,
):
    old, new = sessions = [Session(), Session()]
    opened = iter(sessions)
    monkeypatch.setattr(client, "connect_to_hub", lambda *_: next(opened))
    with Client("lab", "uav"):
        old.hubs = []
    assert not old.is_closed, "with a frozen hub that takes seconds"
    with Client("lab", "uav"):
        assert (old.is_closed, new.is_closed) == (True, False)
    assert new.is_closed
