"""Asking the bus who is there."""

import zenoh

from services.runtime import graph

_TIMEOUT = 1.0
"""Seconds; the hub answers for all from its own tables, in half a millisecond."""


def nodes(session: zenoh.Session, vehicle: str) -> list[str]:
    """The names of the ready nodes."""
    found = (graph.node_of(key) for key in _keys(session, f"{vehicle}/@node/*"))
    return sorted(name for name in found if name is not None)


def offers(session: zenoh.Session, vehicle: str) -> list[graph.Offer]:
    """Every topic and service that live nodes offer."""
    keys = [
        key for kind in ("@pub", "@srv") for key in _keys(session, f"{vehicle}/@node/*/{kind}/**")
    ]
    found = (graph.offer_of(key) for key in keys)
    return sorted((offer for offer in found if offer is not None), key=lambda offer: offer.key)


def _keys(session: zenoh.Session, pattern: str) -> list[str]:
    replies = session.liveliness().get(pattern, timeout=_TIMEOUT)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
