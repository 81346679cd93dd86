"""Zenoh's access control, from roles and the list of names, or from nodes.

Everything not listed is denied, and no rule relies on a denial: a rule counts only if its key
covers all of the message's, so a denial of `uav/input/position` would miss a message put on
`uav/input/*`. The one denial that exists only saves traffic.
"""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

from quadctl.schemas.roles import EVERY, ROLES, Right, Rights, Role, patterns, rights_of
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security.identity import Identity, Name, needed

_FROM: dict[Right, list[str]] = {
    "publish": ["put"],
    "listen": ["declare_subscriber"],
    "call": ["query"],
    "read": ["query"],
    "serve": ["declare_queryable", "reply"],
    "announce": ["liveliness_token"],
}
"""The messages that a right lets in."""
_TO: dict[Right, list[str]] = {
    "listen": ["put"],
    "call": ["reply", "declare_queryable"],
    "read": ["reply", "declare_queryable"],
    "serve": ["query"],
    "see": ["liveliness_token"],
}
"""The messages that a right lets out to its holder."""

_LIVELINESS = ["liveliness_query", "declare_liveliness_subscriber"]
_ROLL = ["*/@node/*", "*/@node/*/@pub/**", "*/@node/*/@srv/**", "*/@node/*/@sub/**"]
"""Everyone may ask for all nodes and endpoints; only the answers need the right `see`."""
_EVERYWHERE = ["**", "*/@all/**", "*/@call/**", "*/@srv/**", "*/@node/**", *_ROLL]

_MESSAGES = sorted({m for side in (_FROM, _TO) for messages in side.values() for m in messages})


Group = tuple[Role, tuple[str, ...]]
"""Role and vehicles: what its members may do."""


def groups(names: Iterable[Name], now: float) -> dict[Group, list[str]]:
    """Return the common names of the certificates that are valid at `now` (Unix s), by group.

    Groups of one vehicle or of all are there before they have a member: so a new member of one
    changes nothing for Zenoh, which reads its access control only once.
    """
    valid = [name for name in names if name.expires > now]
    vehicles = {EVERY, *(vehicle for name in valid for vehicle in name.vehicles)}
    found: dict[Group, list[str]] = {
        (role, (vehicle,)): [] for vehicle in sorted(vehicles) for role in ROLES
    }
    for name in valid:
        found.setdefault((name.role, tuple(name.vehicles)), []).append(name.common_name)
    return found


def member(role: Role, vehicles: Sequence[str], expires: float) -> Name:
    """Return the name of a certificate that the door makes for a group; `expires` in Unix s."""
    serial = hashlib.sha256(" ".join(vehicles).encode()).hexdigest()[:16]
    return Name("door", role, list(vehicles), serial, expires)


def access_control(names: Iterable[Name], now: float, link: str) -> dict[str, Any]:
    """Return Zenoh's `access_control` for the names' certificates that are valid at `now` (Unix s).

    All traffic over the protocol `link`, which is our own hub's, is allowed.
    """
    members = groups(names, now)
    named = {vehicle for _, vehicles in members for vehicle in vehicles}
    granted = [_everything({"link_protocols": [link]})]
    for (role, vehicles), certificates in members.items():
        subject = f"{role} of {' '.join(vehicles)}"
        rules = [*_granted(subject, ROLES[role], vehicles)]
        if role == "hub" and EVERY not in vehicles:
            # The clients of that hub may subscribe to all vehicles, but receive only those of the hub.
            rules.append(_rule(f"{subject} listens", "ingress", ["declare_subscriber"], ["**"]))
        rules += _denied(subject, vehicles, named - {EVERY, *vehicles})
        ours = member(role, vehicles, now).common_name
        granted.append(({"id": subject, "cert_common_names": [*certificates, ours]}, rules))
    return _configured(granted)


def for_nodes(user: str, nodes: Iterable[str]) -> dict[str, Any]:
    """Return Zenoh's `access_control` for a hub of users: `user` may do all, each node its own part."""
    granted = [_everything({"usernames": [user]})]
    granted += [
        ({"id": node, "usernames": [node]}, [*_granted(node, rights_of(node), [EVERY])])
        for node in nodes
    ]
    return _configured(granted)


_Granted = tuple[dict[str, Any], list[dict[str, Any]]]
"""Subject, and the rules that apply to it."""


def _configured(granted: Sequence[_Granted]) -> dict[str, Any]:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for _, rules in granted for rule in rules],
        "subjects": [subject for subject, _ in granted],
        "policies": [
            {"rules": [rule["id"] for rule in rules], "subjects": [subject["id"]]}
            for subject, rules in granted
        ],
    }


def _everything(holder: dict[str, Any]) -> _Granted:
    messages = [*_MESSAGES, *_LIVELINESS]
    rules = [_rule("own", flow, messages, _EVERYWHERE) for flow in ("ingress", "egress")]
    return {"id": "own", **holder}, rules


def _granted(subject: str, rights: Rights, vehicles: Sequence[str]) -> Iterable[dict[str, Any]]:
    for flow, side in (("ingress", _FROM), ("egress", _TO)):
        for right, messages in side.items():
            if keys := patterns(rights, vehicles, right):
                yield _rule(f"{subject} {right}", flow, messages, keys)
    yield _rule(f"{subject} asks", "ingress", _LIVELINESS, _ROLL)
    # A subscriber or query comes with its own pattern, which may be wider than the subject's keys.
    if patterns(rights, vehicles, "publish"):
        yield _rule(f"{subject} sees subscribers", "egress", ["declare_subscriber"], _EVERYWHERE)
    if patterns(rights, vehicles, "announce"):
        yield _rule(f"{subject} sees queries", "egress", _LIVELINESS, _EVERYWHERE)


def _denied(subject: str, vehicles: Sequence[str], others: Iterable[str]) -> list[dict[str, Any]]:
    # Without this, each of thirty hubs would receive the subscriptions of all others; and a client
    # that publishes to another hub's vehicle would see a subscriber, but no message gets there.
    keys = [f"{other}/{name}" for other in others for name in ("**", "@call/**")]
    if EVERY in vehicles or not keys:
        return []
    return [_rule(f"{subject} not for others", "egress", ["declare_subscriber"], keys, "deny")]


def _rule(
    about: str, flow: str, messages: list[str], keys: list[str], permission: str = "allow"
) -> dict[str, Any]:
    return {
        "id": f"{about} {flow}",
        "permission": permission,
        "flows": [flow],
        "messages": messages,
        "key_exprs": sorted(set(keys)),
    }


def identity_for(endpoints: Sequence[str]) -> Identity:
    """Return the hub's identity; raises UsageError if none is given, or its role is not hub."""
    identity = needed(endpoints[0])
    if identity.name.role != "hub":
        raise UsageError(
            f"{endpoints[0]} needs the identity of a hub: {identity.folder} belongs to the"
            f" {identity.name.role} {identity.name.name}",
            "`quadctl keys issue hub field` makes one",
        )
    return identity
