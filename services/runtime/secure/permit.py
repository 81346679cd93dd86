"""What our own certificate lets us do, known before we ask: who is denied is not answered.

The hub enforces; this says why. Without a certificate, on the Unix socket, all is allowed.
"""

import time
from collections.abc import Sequence

import zenoh

from schemas.roles import Right, keys, may
from schemas.topics import INFO
from services.runtime.bus import graph
from services.runtime.errors import NotAllowed
from services.runtime.secure.endpoints import is_secure
from services.runtime.secure.identity import needed
from services.runtime.secure.name import Name

IN_FORCE = 5.0
"""Seconds in which a new list of names is in force however busy the machine; mostly it is half of one."""
_POLL = 0.05
_LOOK = 0.5
"""Seconds in which a vehicle that is there has said so."""
_TO: dict[Right, str] = {"listen": "listen to", "publish": "publish on", "see": "see"}


def allows(connect: str, right: Right, key: str) -> bool:
    """Whether our role over that endpoint extends to a key or expression."""
    if not is_secure(connect):
        return True
    who = needed(connect).name
    return may(who.role, who.vehicles, right, key)


def check(connect: str, right: Right, *asked: str) -> None:
    """Raise NotAllowed where our role over that endpoint does not extend to a key or expression."""
    for key in asked:
        if not allows(connect, right, key):
            who = needed(connect).name
            raise NotAllowed(
                f"not allowed: {_one(who)} may not {_TO.get(right, right)} {key}"
                f" (your certificate {who.common_name})",
                _instead(who, right),
            )


def everything(connect: str) -> list[str]:
    """All that our role over that endpoint may listen to; nothing where there are no roles."""
    if not is_secure(connect):
        return []
    who = needed(connect).name
    return keys(who.role, who.vehicles, "listen")


def is_let_in(session: zenoh.Session, timeout: float) -> bool:
    """Whether the hub lets anything of ours through.

    It lets in whoever has a certificate of the fleet, but tells only those on its list who it is.
    """
    replies = session.liveliness().get(graph.node_key("*", "gate"), timeout=timeout)
    return any(reply.ok is not None for reply in replies)


def welcome(session: zenoh.Session, connect: str, timeout: float) -> None:
    """Raise NotAllowed where the hub at that endpoint lets nothing of ours through in time (s).

    For a session that comes back by itself to a gate that opens anew.
    """
    if not is_secure(connect):
        return
    deadline = time.monotonic() + min(timeout, IN_FORCE)
    while not is_let_in(session, timeout):
        if time.monotonic() > deadline:
            raise kept_out(connect)
        time.sleep(_POLL)


def kept_out(connect: str) -> NotAllowed:
    """What is known of a hub that lets nothing of ours through."""
    return NotAllowed(
        f"not allowed: {connect} lets nothing through for {needed(connect).name.common_name}",
        "the certificate was revoked, or the hub has an old list of names: have one issued",
    )


def tell_apart(
    session: zenoh.Session, connect: str, key: str, offers: Sequence[graph.Offer]
) -> None:
    """Raise NotAllowed where a key is served that nobody answered: the hub has kept us from it.

    Our certificate may say more than the hub's list. What that denies we may not even see, but `info`
    of every vehicle may be read by all.
    """
    if not is_secure(connect):
        return
    offered = any(offer.key == key for offer in offers)
    if offered or (not offers and _informs(session, key.partition("/")[0])):
        raise NotAllowed(
            f"not allowed: {connect} keeps {needed(connect).name.common_name} from {key}",
            "it is served: the hub's list of names says less than your certificate, or its quadctl is"
            " another version",
        )


def _informs(session: zenoh.Session, vehicle: str) -> bool:
    return any(reply.ok for reply in session.get(INFO.key(vehicle), timeout=_LOOK))


def _one(who: Name) -> str:
    article = "an" if who.role[0] in "aeiou" else "a"
    return f"{article} {who.role} of {who.of}"


def _instead(who: Name, right: Right) -> str:
    granted = keys(who.role, who.vehicles, right)
    if not granted:
        return "`quadctl keys issue operator` would make a certificate that may"
    return f"it may {', '.join(granted[:6])}{' ..' if len(granted) > 6 else ''}"
