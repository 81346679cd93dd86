"""Whether a session's connection to its hub was lost meanwhile, though it be back by now."""

from typing import Any

import zenoh

_KEPT = 16
"""Changes that are kept until somebody asks; the oldest go first, and one that is left says enough."""


class Breaks:
    """Counted from now on, by Zenoh: no thread of its wakes Python for it."""

    def __init__(self, session: zenoh.Session) -> None:
        """Of a client, whose one connection is that to the hub."""
        channel: Any = zenoh.handlers.RingChannel(_KEPT)
        self._changes = session.info.declare_transport_events_listener(channel)

    def any(self) -> bool:
        """Whether there was one since this was asked last."""
        found = False
        while (change := self._changes.try_recv()) is not None:
            found |= change.kind == zenoh.SampleKind.DELETE
        return found
