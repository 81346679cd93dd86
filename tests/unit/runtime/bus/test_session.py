"""Closing of a session that other threads use."""

from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from quadctl.services.runtime.bus.calls import RawServiceClient
from quadctl.services.runtime.bus.liveliness import offers
from quadctl.services.runtime.bus.session import closing
from quadctl.services.runtime.errors import Unreachable


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


ALONE = '{mode: "peer", scouting: {multicast: {enabled: false}}, listen: {endpoints: []}}'
USES: dict[str, Callable[[zenoh.Session], object]] = {
    "a call": lambda session: RawServiceClient(session, "uav/@srv/hold").call(b"", "", 1.0),
    "a question": lambda session: offers(session, "uav", "@srv"),
}


@pytest.mark.parametrize("use", USES)
def test_one_that_another_thread_has_closed_is_unreachable(use: str):
    session = zenoh.open(zenoh.Config.from_json5(ALONE))
    session.close()
    with pytest.raises(Unreachable, match="the connection is closed"):
        USES[use](session)


def test_an_error_of_an_open_one_stays_as_it_is():
    with zenoh.open(zenoh.Config.from_json5(ALONE)) as session, pytest.raises(zenoh.ZError):
        RawServiceClient(session, "uav//hold")
