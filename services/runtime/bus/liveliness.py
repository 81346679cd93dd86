"""Queries to the hub about live nodes, vehicles and their endpoints."""

from collections.abc import Iterable
from typing import NamedTuple

import zenoh

from quadctl.schemas import keyexpr
from quadctl.services.runtime.bus.session import unless_closed
from quadctl.services.runtime.errors import TimedOut

_TIMEOUT = 1.0
"""Seconds; the hub answers for all from its own tables, in 0.5 ms."""


def nodes(session: zenoh.Session, vehicle: str, timeout: float = _TIMEOUT) -> list[str]:
    """Return the names of the ready nodes; raise TimedOut if the hub gives none in time (s)."""
    found = (keyexpr.node_of(key) for key in _keys(session, f"{vehicle}/@node/*", timeout))
    return sorted(name for name in found if name is not None)


def vehicles(session: zenoh.Session, timeout: float = _TIMEOUT) -> list[str]:
    """Return the vehicles with a ready node or a substitute for one; raise as `nodes`."""
    from quadctl.services.runtime.process_table import NODES

    found = _keys(session, "*/@node/*", timeout)
    # A hub, a recorder or a user's node outlives its vehicle.
    only_with_one = set(NODES) - {"hub"}
    own = {keyexpr.vehicle_of(key) for key in found if keyexpr.node_of(key) in only_with_one}
    others = {keyexpr.vehicle_of(key) for key in found} - own
    return sorted(own | {name for name in others if _flies(session, name, timeout)})


def _flies(session: zenoh.Session, vehicle: str, timeout: float) -> bool:
    """Return whether any node, of any name, offers the endpoints that identify a vehicle."""
    from quadctl.schemas.topics import GOTO, POSE

    known_by = {POSE.key(vehicle), GOTO.key(vehicle)}
    found = offers(session, vehicle, "@pub", "@srv", timeout=timeout)
    return any(offer.key in known_by for offer in found)


def offers(
    session: zenoh.Session, vehicle: str, *kinds: keyexpr.Kind, timeout: float = _TIMEOUT
) -> list[keyexpr.EndpointInfo]:
    """Return the endpoints of these kinds of a vehicle's live nodes, by key; raise as `nodes`.

    The vehicle `*` means all vehicles of the hub.
    """
    found = [
        keyexpr.offer_of(key)
        for kind in kinds
        for key in _keys(session, f"{vehicle}/@node/*/{kind}/**", timeout)
    ]
    return sorted((offer for offer in found if offer is not None), key=lambda offer: offer.key)


class Present(NamedTuple):
    """Ready nodes, each as its vehicle and name, and for each service's key the node that serves it."""

    nodes: frozenset[tuple[str, str]]
    servers: dict[str, str]


def present(session: zenoh.Session, vehicles: Iterable[str]) -> Present:
    """Return the nodes and servers of vehicles, `*` for all of a hub; raise as `nodes`.

    A node that starts asks it. It waits for a hub that is busy, as long as it may take to start.
    """
    from quadctl.services.runtime.process_table import START_TIMEOUT

    nodes: set[tuple[str, str]] = set()
    servers: dict[str, str] = {}
    for vehicle in vehicles:
        for key in _keys(session, f"{vehicle}/@node/*", START_TIMEOUT):
            nodes.add((keyexpr.vehicle_of(key), keyexpr.node_of(key) or ""))
        for offer in offers(session, vehicle, "@srv", timeout=START_TIMEOUT):
            servers[offer.key] = offer.node
    return Present(frozenset(nodes), servers)


def _keys(session: zenoh.Session, pattern: str, timeout: float) -> list[str]:
    found = []
    with unless_closed(session):
        for reply in session.liveliness().get(pattern, timeout=timeout):
            if reply.ok is None:
                hint = "its process is frozen or busy: `quadctl status`"
                raise TimedOut("the hub does not answer", hint)
            found.append(str(reply.ok.key_expr))
    return found


def covers(pattern: str, key: str) -> bool:
    """Return whether a key or key expression matches this key."""
    if "*" not in pattern:
        return pattern == key
    try:
        return zenoh.KeyExpr(pattern).intersects(zenoh.KeyExpr(key))
    except zenoh.ZError:
        # A foreign node may declare an invalid key.
        return False
