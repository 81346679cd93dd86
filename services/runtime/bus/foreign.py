"""Client of a Zenoh router that is not a hub of ours: its keys, payloads and attachments are free."""

import contextlib
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from quadctl.services.runtime.bus import zenoh_events
from quadctl.services.runtime.bus.session import (
    CLIENT_THREADS,
    JOIN_MS,
    Address,
    common_config,
    open_with,
    retry,
)


class ForeignQuery:
    """Query of a foreign client; keep it no longer than until its answer."""

    def __init__(self, query: zenoh.Query, key: str) -> None:
        self._query, self._key = query, key
        # Copied at once, as in a Subscription.
        self.payload = _bytes(query.payload)
        self.attachment = _bytes(query.attachment)

    def reply(self, payload: bytes, attachment: bytes) -> None:
        """Answer the query, if its client is still there."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply(self._key, payload, attachment=attachment)

    def refuse(self, reason: str) -> None:
        """Answer the query with an error."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(reason.encode())


class ForeignPublisher:
    """Publisher of a key, for as long as it is kept; drops what a slow reader has no room for."""

    def __init__(self, session: zenoh.Session, key: str, *, latched: bool) -> None:
        control = zenoh.CongestionControl.DROP
        self._matches: zenoh_events.MatchingListener | None = None
        self._publisher: Any
        if latched:
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session,
                key,
                cache=zenoh.ext.CacheConfig(1),
                publisher_detection=True,
                congestion_control=control,
            )
        else:
            self._publisher = session.declare_publisher(key, congestion_control=control)
            self._matches = zenoh_events.MatchingListener(self._publisher)

    @property
    def is_wanted(self) -> bool:
        """Return whether a message has a reader, or is kept for a late one."""
        return self._matches is None or self._matches.was_there

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish a message."""
        self._publisher.put(payload, attachment=attachment)


class ForeignSession:
    """Session that reconnects by itself while it lives, and restores what it has declared.

    All but publishers lasts as long as the session. Handlers run on a thread of Zenoh and must
    not block.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[object] = []

    @property
    def zid(self) -> str:
        """Return the session's id in the network."""
        return str(self._session.zid())

    def publisher(self, key: str, *, latched: bool = False) -> "ForeignPublisher":
        """Declare a publisher; one that is latched sends its last message to late subscribers."""
        return ForeignPublisher(self._session, key, latched=latched)

    def subscribe(self, key: str, handler: Callable[[bytes], None]) -> None:
        """Declare a subscriber; the handler gets each payload."""

        def on_sample(sample: zenoh.Sample) -> None:
            zenoh_events.pin_thread_state()
            handler(sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(on_sample, indirect=False)
        self._declared.append(self._session.declare_subscriber(key, callback))

    def serve(self, key: str, handler: Callable[[ForeignQuery], None]) -> None:
        """Declare a server; the handler, or a thread after it, answers each query."""

        def on_query(query: zenoh.Query) -> None:
            zenoh_events.pin_thread_state()
            handler(ForeignQuery(query, key))

        callback = zenoh.handlers.Callback(on_query, indirect=False)
        self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def announce(self, token: str) -> None:
        """Declare a liveliness token."""
        self._declared.append(self._session.liveliness().declare_token(token))


def open_foreign(endpoint: str) -> ForeignSession | None:
    """Open a client of the router at an endpoint; return None if none is there now."""
    config = common_config(Address(endpoint))
    # Zenoh would open no client without its router, and wait for it in a call that never returns.
    config["mode"] = "client"
    config["connect"] = {"endpoints": [endpoint], "timeout_ms": 0, "retry": retry(JOIN_MS)}
    # The last message of a latched publisher is kept by its time.
    config["timestamping"] = {"enabled": True}
    try:
        return ForeignSession(open_with(config, CLIENT_THREADS))
    except zenoh.ZError:
        return None


def _bytes(part: zenoh.ZBytes | None) -> bytes:
    return b"" if part is None else part.to_bytes()
