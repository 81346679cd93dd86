"""Closing of a session that other threads use."""

from typing import Any

import pytest

from quadctl.services.runtime.bus.session import closing


class Busy:
    """Session that refuses to be closed until some calls of other threads have ended, as the binding's does."""

    def __init__(self, calls: int) -> None:
        self.calls = calls

    def close(self) -> None:
        if self.calls:
            self.calls -= 1
            raise RuntimeError("Already borrowed")


def test_a_session_in_use_by_another_thread_is_closed_after_it():
    session: Any = Busy(calls=3)
    with closing(session) as opened:
        assert opened is session
        assert session.calls == 3
    assert session.calls == 0


def test_one_that_is_never_free_is_reported(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("quadctl.services.runtime.bus.session._CALLS", 0.01)
    session: Any = Busy(calls=10**9)
    with pytest.raises(RuntimeError, match="Already borrowed"), closing(session):
        pass
