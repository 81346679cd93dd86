"""Whether somebody is at the other end."""

import threading
from typing import Any

import zenoh

from services.runtime.bus import foreign


class Matching:
    """Of a querier or a publisher, as the hub tells; to look at it often costs nothing."""

    def __init__(self, end: zenoh.Querier | zenoh.Publisher) -> None:
        self._end = end
        self._listener: zenoh.MatchingListener[None] | None = None
        self._there, self._changes = threading.Event(), 0

    @property
    def is_there(self) -> bool:
        """Whether the hub has told of somebody."""
        self._listen()
        return self._there.is_set()

    def wait(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for somebody; False where nobody came."""
        self._listen()
        return self._there.wait(max(timeout, 0))

    def _listen(self) -> None:
        # Where nobody looks, nothing is declared: of a thousand ends that takes time.
        if self._listener is None:
            callback = zenoh.handlers.Callback(self._on_change, indirect=False)
            self._listener = self._end.declare_matching_listener(callback)
            # It tells of changes alone; one that came meanwhile is newer than what is asked here.
            before, status = self._changes, self._status
            if self._changes == before and status:
                self._there.set()

    @property
    def _status(self) -> bool:
        status: Any = self._end.matching_status  # the stubs take it for a bool
        return bool(status.matching)

    def _on_change(self, status: zenoh.MatchingStatus) -> None:
        foreign.stay()
        self._changes += 1
        if status.matching:
            self._there.set()
        else:
            self._there.clear()
