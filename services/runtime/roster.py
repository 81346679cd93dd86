"""Asking the bus who is there."""

import zenoh

from services.runtime import graph
from services.runtime.errors import TimedOut

_ROUTERS = ("hub", "gate")
"""Nodes that a hub alone has, too."""
_TIMEOUT = 1.0
"""Seconds; the hub answers for all from its own tables, in half a millisecond."""


def nodes(session: zenoh.Session, vehicle: str, timeout: float = _TIMEOUT) -> list[str]:
    """The names of the ready nodes; raises TimedOut where the hub does not answer in time (s)."""
    found = (graph.node_of(key) for key in _keys(session, f"{vehicle}/@node/*", timeout))
    return sorted(name for name in found if name is not None)


def vehicles(session: zenoh.Session, timeout: float = _TIMEOUT) -> list[str]:
    """The vehicles that have a ready node besides a hub; raises as `nodes`."""
    found = _keys(session, "*/@node/*", timeout)
    return sorted({graph.vehicle_of(key) for key in found if graph.node_of(key) not in _ROUTERS})


def offers(session: zenoh.Session, vehicle: str, timeout: float = _TIMEOUT) -> list[graph.Offer]:
    """Every topic and service that live nodes offer; raises as `nodes`."""
    keys = [
        key
        for kind in ("@pub", "@srv")
        for key in _keys(session, f"{vehicle}/@node/*/{kind}/**", timeout)
    ]
    found = (graph.offer_of(key) for key in keys)
    return sorted((offer for offer in found if offer is not None), key=lambda offer: offer.key)


def _keys(session: zenoh.Session, pattern: str, timeout: float) -> list[str]:
    found = []
    for reply in session.liveliness().get(pattern, timeout=timeout):
        if reply.ok is None:
            raise TimedOut(
                "the hub does not answer", "its process is frozen or busy: `quadctl status`"
            )
        found.append(str(reply.ok.key_expr))
    return found


def covers(pattern: str, key: str) -> bool:
    """Whether a key, or one that an expression stands for, is this one."""
    if "*" not in pattern:
        return pattern == key
    try:
        return zenoh.KeyExpr(pattern).intersects(zenoh.KeyExpr(key))
    except zenoh.ZError:
        # A stranger may announce what is no key.
        return False
