"""Bounds of the messages that wait for a reader."""

from types import SimpleNamespace
from typing import Any

import pytest

from quadctl.services.runtime.bus import streams
from quadctl.services.runtime.bus.streams import QueuedSubscriber


class Session:
    """Session that hands the callback of a subscription to the test."""

    def declare_subscriber(self, _key: str, callback: Any) -> None:
        self.publish = callback.callback


def sample(size: int) -> Any:
    payload = SimpleNamespace(to_bytes=lambda: b"x" * size)
    return SimpleNamespace(key_expr="a", timestamp=None, payload=payload, encoding="")


@pytest.mark.parametrize(
    ("sizes", "kept"),
    [
        ([1, 2, 3], [1, 2, 3]),
        ([1, 2, 3, 4, 5], [2, 3, 4, 5]),
        ([10, 20, 90], [90]),
        ([200], [200]),
    ],
)
def test_the_oldest_make_room_for_the_newest(
    monkeypatch: pytest.MonkeyPatch, sizes: list[int], kept: list[int]
):
    monkeypatch.setattr(streams, "_ROOM", 100)
    session: Any = Session()
    stream = QueuedSubscriber(session, ("a",), 4)
    for _ in range(2):
        for size in sizes:
            session.publish(sample(size))
        lost = stream.lost
        assert [len(m.payload) for m in iter(lambda: stream.next(0), None)] == kept
        assert lost % (len(sizes) - len(kept) or 1) == 0
        assert not stream.waiting
