"""Whether somebody is at the other end."""

import threading
import weakref
from typing import Any

import zenoh

from services.runtime.bus import foreign


class Matching:
    """Of a querier or a publisher, as the hub tells."""

    def __init__(self, end: zenoh.Querier | zenoh.Publisher) -> None:
        self._end = end
        self._listener: zenoh.MatchingListener[None] | None = None
        self._there, self._changes = threading.Event(), 0

    @property
    def is_there(self) -> bool:
        """Whether the hub has told of somebody up to now; a listener is told of it later."""
        status: Any = self._end.matching_status  # the stubs take it for a bool
        return bool(status.matching)

    def wait(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for somebody; False where nobody came."""
        if self.is_there:
            return True
        self._listen()
        return self._there.wait(max(timeout, 0))

    @property
    def changes(self) -> int:
        """How often somebody came or went, since this was first looked at."""
        self._listen()
        return self._changes

    def _listen(self) -> None:
        # Where nobody waits, nothing is declared: of a thousand ends that takes time.
        if self._listener is None:
            # Weakly: what the listener holds is not let go while it is ours.
            told = weakref.WeakMethod(self._on_change)

            def on_change(status: zenoh.MatchingStatus) -> None:
                if tell := told():
                    tell(status)

            callback = zenoh.handlers.Callback(on_change, indirect=False)
            self._listener = self._end.declare_matching_listener(callback)
            # It tells of changes alone; one that came meanwhile is newer than what is asked here.
            before, there = self._changes, self.is_there
            if self._changes == before and there:
                self._there.set()

    def _on_change(self, status: zenoh.MatchingStatus) -> None:
        foreign.stay()
        self._changes += 1
        if status.matching:
            self._there.set()
        else:
            self._there.clear()
