"""Zenoh's events: a matching end, a lost link; and the Python state of its threads."""

import ctypes
import threading
import weakref
from typing import Any

import zenoh

ALL_SERVERS: Any = {
    "target": zenoh.QueryTarget.ALL,
    "consolidation": zenoh.ConsolidationMode.NONE,
}
"""Arguments of a query for the answers of all, none held back."""
ONE_SERVER: Any = {**ALL_SERVERS, "target": zenoh.QueryTarget.BEST_MATCHING}
"""Arguments of a query for the answer of one."""

_KEPT = 16
"""Changes that are kept until somebody asks; the oldest go first, and one that is left says enough."""


class DisconnectListener:
    """Counted from now on, by Zenoh: no thread of its wakes Python for it."""

    def __init__(self, session: zenoh.Session) -> None:
        """Of a client, whose one connection is that to the hub."""
        channel: Any = zenoh.handlers.RingChannel(_KEPT)
        self._changes = session.info.declare_transport_events_listener(channel)

    def fired(self) -> bool:
        """Whether there was one since this was asked last."""
        found = False
        while (change := self._changes.try_recv()) is not None:
            found |= change.kind == zenoh.SampleKind.DELETE
        return found


_known = threading.local()


def pin_thread_state() -> None:
    """Let this thread of Zenoh's keep its place in the interpreter; first thing in a callback.

    The binding makes a thread state for each callback and drops it afterwards: with the memory
    mapped and unmapped for it, some 40 us a message. One hold more than is let go keeps it.
    """
    try:
        _known.here  # noqa: B018 - asked so with each message, for which hasattr takes too long
    except AttributeError:
        _known.here = True
        ctypes.pythonapi.PyGILState_Ensure()


class MatchingListener:
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
        pin_thread_state()
        self._changes += 1
        if status.matching:
            self._there.set()
        else:
            self._there.clear()
