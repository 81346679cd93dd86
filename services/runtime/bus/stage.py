"""Says on the bus again what was said there once, byte for byte, under the same keys."""

from typing import Any

import zenoh

from schemas.topics import topic_of
from services.runtime.bus import foreign, graph, roster, wire
from services.runtime.errors import AlreadyServed

NAME = "replay"


class Stage:
    """Plays the part of all who once published on some keys.

    The keys are listed as theirs were, and those of latched topics answer.
    """

    def __init__(self, session: zenoh.Session, keys: dict[str, str]) -> None:
        """`keys` has the encoding of each key. Raises AlreadyServed where somebody has one.

        A vehicle that is live has all of its keys.
        """
        vehicles = {key.partition("/")[0] for key in keys}
        for vehicle in sorted(vehicles):
            _refuse_beside_the_living(session, vehicle, keys)
        self._outlets = {key: _Outlet(session, key) for key in keys}
        tokens = [graph.offer_key(key.partition("/")[0], offer) for key, offer in _offers(keys)]
        # Last, as ever: who sees a node may already ask it.
        tokens += [graph.node_key(vehicle, NAME) for vehicle in vehicles]
        self._tokens = [session.liveliness().declare_token(token) for token in tokens]

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        """Say a message."""
        self._outlets[key].put(payload, encoding)


class _Outlet:
    """One key's end; what is latched answers with the last message."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._last: tuple[bytes, str] | None = None
        # Nothing of a recording is lost to a slow subscriber; the hub waits a second for it.
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
        foreign.stay()
        with query:
            if self._last is not None:
                payload, encoding = self._last
                query.reply(self._key, payload, encoding=encoding)


def _offers(keys: dict[str, str]) -> list[tuple[str, graph.Offer]]:
    """What listings shall show: the keys whose types are known."""
    found: list[tuple[str, graph.Offer]] = []
    for key, said in keys.items():
        topic: Any = topic_of(key)
        name, _, digest = said.removeprefix(wire.PREFIX).partition("#")
        if wire.is_typed(said) and name and digest and "/@" not in key:
            hz = topic.hz if topic else 0.0
            found.append((key, graph.Offer("@pub", NAME, name, digest, hz, key)))
    return found


def _refuse_beside_the_living(session: zenoh.Session, vehicle: str, keys: dict[str, str]) -> None:
    hint = "replay in a realm of its own, as with --realm replay"
    if "dynamics" in roster.nodes(session, vehicle):
        raise AlreadyServed(f"the vehicle {vehicle} is live: a replay would be taken for it", hint)
    for offer in roster.offers(session, vehicle):
        if offer.kind == "@pub" and offer.key in keys:
            raise AlreadyServed(
                f"{offer.key} is published by {offer.node}: a replay would be taken for it",
                f"{hint}, or name the keys to replay",
            )
