"""Publisher of a recording."""

from typing import Any

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.topics import topic_of
from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.errors import AlreadyServed

NAME = "replay"


class ReplayPublisher:
    """Publisher of recorded keys in place of their nodes; `keys` has the encoding of each.

    The keys are listed as the nodes listed them, and latched topics answer `get`. Raises
    AlreadyServed if a key has a publisher; a live vehicle publishes all of its keys.
    """

    def __init__(self, session: zenoh.Session, keys: dict[str, str]) -> None:
        vehicles = {key.partition("/")[0] for key in keys}
        for vehicle in sorted(vehicles):
            _refuse_live(session, vehicle, keys)
        self._publishers = {key: _KeyPublisher(session, key) for key in keys}
        tokens = [*map(keyexpr.endpoint_key, _offers(keys))]
        # The nodes' tokens last: a client that sees a node may call it at once.
        tokens += [keyexpr.node_key(vehicle, NAME) for vehicle in vehicles]
        self._tokens = [session.liveliness().declare_token(token) for token in tokens]

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish a message."""
        self._publishers[key].put(payload, encoding)


class _KeyPublisher:
    """Publisher of one key; for a latched topic it answers with the last message."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._last: tuple[bytes, str] | None = None
        # No message is lost to a slow subscriber; the hub waits a second for it.
        self._publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        topic = topic_of(key)
        if topic is not None and topic.latched:
            callback = zenoh.handlers.Callback(self._on_query, indirect=False)
            self._queryable = session.declare_queryable(key, callback, complete=True)

    def put(self, payload: bytes, encoding: str) -> None:
        self._last = payload, encoding
        self._publisher.put(payload, encoding=encoding)

    def _on_query(self, query: zenoh.Query) -> None:
        zenoh_events.pin_thread_state()
        with query:
            if self._last is not None:
                payload, encoding = self._last
                query.reply(self._key, payload, encoding=encoding)


def _offers(keys: dict[str, str]) -> list[keyexpr.EndpointInfo]:
    """Return the endpoints for listings: the keys with known types."""
    found: list[keyexpr.EndpointInfo] = []
    for key, encoding in keys.items():
        topic: Any = topic_of(key)
        name, _, digest = encoding.removeprefix(codec.PREFIX).partition("#")
        if codec.is_typed(encoding) and name and digest and "/@" not in key:
            vehicle, hz = key.partition("/")[0], topic.hz if topic else 0.0
            found.append(keyexpr.EndpointInfo(vehicle, "@pub", NAME, name, digest, hz, key))
    return found


def _refuse_live(session: zenoh.Session, vehicle: str, keys: dict[str, str]) -> None:
    hint = "replay in another realm, e.g. with --realm replay"
    if "dynamics" in liveliness.nodes(session, vehicle):
        raise AlreadyServed(f"vehicle {vehicle} is live: a replay would be mistaken for it", hint)
    for offer in liveliness.offers(session, vehicle, "@pub"):
        if offer.key in keys:
            raise AlreadyServed(
                f"{offer.key} is published by {offer.node}: a replay would be mistaken for it",
                f"{hint}, or replay other keys only",
            )
