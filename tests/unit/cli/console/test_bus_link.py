"""Connection of the console: no error ends it without a word."""

import threading
from typing import Any

import pytest

from quadctl.cli.console import bus_link
from quadctl.cli.console.bus_link import Link
from quadctl.cli.context import Options
from quadctl.services.runtime.errors import Unreachable
from tests.support.running import DEADLINE


def test_any_error_of_a_link_is_shown_and_logged_and_another_attempt_follows(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    errors = [Unreachable("no hub"), ValueError("odd")]
    again = threading.Event()

    def connect(*_: Any, **__: Any) -> None:
        if errors:
            raise errors.pop(0)
        again.set()
        threading.Event().wait()

    monkeypatch.setattr(bus_link, "Client", connect)
    monkeypatch.setattr(bus_link, "_AGAIN", 0.0)
    link = Link(Options("lab", "tcp/127.0.0.1:1", "uav", json=False, timeout=1.0), "uav")
    assert again.wait(DEADLINE)
    assert link.see(lambda board: board.problem) == "odd"
    with pytest.raises(Unreachable, match="not connected: odd"):
        link.client  # noqa: B018 - raises
    (record,) = caplog.records
    assert record.exc_info
    assert record.exc_info[0] is ValueError
