"""Zenoh's events: a matching end, a lost link; and the Python state of its threads."""

import threading
from _weakref import ref  # weakref itself takes 0.5 ms of a command
from collections.abc import Callable
from typing import Any

import zenoh

ALL_SERVERS: Any = {
    "target": zenoh.QueryTarget.ALL,
    "consolidation": zenoh.ConsolidationMode.NONE,
}
"""Arguments of a query for the answers of all servers, each passed on at once."""
ONE_SERVER: Any = {**ALL_SERVERS, "target": zenoh.QueryTarget.BEST_MATCHING}
"""Arguments of a query for the answer of one server."""

_LATCHED = 60.0
"""Seconds that the answer with a latched message may take: nothing waits for it."""
_KEPT = 16
"""Changes kept until they are read; the oldest are dropped, and any one left is enough."""


class DisconnectListener:
    """Listener to losses of a client's one connection; Zenoh counts without waking Python."""

    def __init__(self, session: zenoh.Session) -> None:
        channel: Any = zenoh.handlers.RingChannel(_KEPT)
        self._changes = session.info.declare_transport_events_listener(channel)

    def fired(self) -> bool:
        """Return whether the connection was lost since the previous call."""
        found = False
        while (change := self._changes.try_recv()) is not None:
            found |= change.kind == zenoh.SampleKind.DELETE
        return found


_known = threading.local()


def pin_thread_state() -> None:
    """Pin the Python thread state of this Zenoh thread. Call it first in a callback of messages.

    The binding makes a thread state for each callback and drops it afterwards: with the memory
    mapped and unmapped for it, some 40 us a message. One Ensure without a Release keeps it.
    """
    try:
        _known.here  # noqa: B018 - runs for each message, and hasattr is too slow
    except AttributeError:
        import ctypes  # takes 2 ms, and a command that only asks has no callback

        _known.here = True
        ctypes.pythonapi.PyGILState_Ensure()


def request_latched(session: zenoh.Session, key: str, take: Callable[[zenoh.Sample], None]) -> None:
    """Request the last message of each latched topic that matches a key, on a thread of Zenoh's."""

    def on_reply(reply: zenoh.Reply) -> None:
        pin_thread_state()
        if (sample := reply.ok) is not None:
            take(sample)

    callback = zenoh.handlers.Callback(on_reply, indirect=False)
    session.get(key, callback, timeout=_LATCHED, **ALL_SERVERS)


class MatchingListener:
    """Listener to the matching servers of a querier or subscribers of a publisher.

    From the first use on, `on_change` is called after each change, on a Zenoh thread.
    """

    def __init__(
        self, end: zenoh.Querier | zenoh.Publisher, on_change: Callable[[], None] = lambda: None
    ) -> None:
        self._end, self._on_change = end, on_change
        self._listener: zenoh.MatchingListener[None] | None = None
        self._there, self._changes = threading.Event(), 0
        self._waited = False

    @property
    def is_there(self) -> bool:
        """Return whether the hub has reported a match; the listener is called only later."""
        status: Any = self._end.matching_status  # the stubs take it for a bool
        return bool(status.matching)

    def wait(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for a match; return False if none came.

        From the second wait on, the listener's last report counts: to read the status at each call
        makes a second thread of Zenoh work, which takes as long as half the call.
        """
        if not self._waited:
            self._waited = True
            if self.is_there:
                return True
        self._listen()
        return self._there.wait(max(timeout, 0))

    @property
    def was_there(self) -> bool:
        """Return the last report of the listener, which takes no call of Zenoh."""
        if self._listener is None:
            self._listen()
        return self._there.is_set()

    @property
    def changes(self) -> int:
        """Return how many changes of the match were reported since the first use."""
        self._listen()
        return self._changes

    def _listen(self) -> None:
        # Declared on demand only: for a thousand ends it takes time.
        if self._listener is None:
            # A weak reference: the listener would keep us alive, and we keep the listener.
            reference = ref(self)

            def on_change(status: zenoh.MatchingStatus) -> None:
                if listener := reference():
                    listener.on_change(status)

            callback = zenoh.handlers.Callback(on_change, indirect=False)
            self._listener = self._end.declare_matching_listener(callback)
            # Only changes are reported; a change before this check is newer than its result.
            before, there = self._changes, self.is_there
            if self._changes == before and there:
                self._there.set()

    def on_change(self, status: zenoh.MatchingStatus) -> None:
        """Take a report of Zenoh: whether there is a match now."""
        self._changes += 1
        if status.matching:
            self._there.set()
        else:
            self._there.clear()
        self._on_change()
