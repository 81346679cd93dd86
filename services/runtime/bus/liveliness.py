"""Queries to the hub about live nodes, vehicles and their endpoints."""

import zenoh

from quadctl.schemas import keyexpr
from quadctl.services.runtime.errors import TimedOut
from quadctl.services.runtime.process_table import NODES

_VEHICLES_OWN = frozenset(NODES) - {"hub"}
"""Nodes that there are where a vehicle is. A recorder or a user's node outlives it."""
_TIMEOUT = 1.0
"""Seconds; the hub answers for all from its own tables, in half a millisecond."""


def nodes(session: zenoh.Session, vehicle: str, timeout: float = _TIMEOUT) -> list[str]:
    """The names of the ready nodes; raises TimedOut where the hub does not answer in time (s)."""
    found = (keyexpr.node_of(key) for key in _keys(session, f"{vehicle}/@node/*", timeout))
    return sorted(name for name in found if name is not None)


def vehicles(session: zenoh.Session, timeout: float = _TIMEOUT) -> list[str]:
    """The vehicles that are there: a node of theirs is ready, or whoever stands in for one.

    Raises as `nodes`.
    """
    found = _keys(session, "*/@node/*", timeout)
    own = {keyexpr.vehicle_of(key) for key in found if keyexpr.node_of(key) in _VEHICLES_OWN}
    others = {keyexpr.vehicle_of(key) for key in found} - own
    return sorted(own | {name for name in others if _flies(session, name, timeout)})


def _flies(session: zenoh.Session, vehicle: str, timeout: float) -> bool:
    """Whether somebody offers what a vehicle is known by, whatever the node's name."""
    from quadctl.schemas.topics import GOTO, POSE

    known_by = {POSE.key(vehicle), GOTO.key(vehicle)}
    return any(offer.key in known_by for offer in offers(session, vehicle, timeout))


def offers(
    session: zenoh.Session, vehicle: str, timeout: float = _TIMEOUT
) -> list[keyexpr.EndpointInfo]:
    """Every topic and service that live nodes offer; raises as `nodes`."""
    keys = [
        key
        for kind in ("@pub", "@srv")
        for key in _keys(session, f"{vehicle}/@node/*/{kind}/**", timeout)
    ]
    found = (keyexpr.offer_of(key) for key in keys)
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
