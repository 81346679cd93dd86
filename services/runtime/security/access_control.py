"""Zenoh's access control from roles and the list of names, and the watch on that list.

Everything not listed is denied, and no rule relies on a denial: a rule counts only if its key
covers all of the message's, so a denial of `uav/input/position` would miss a message put on
`uav/input/*`. The one denial that exists only saves traffic.
"""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from quadctl.schemas.roles import EVERY, Right, Role, keys
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security import registry
from quadctl.services.runtime.security.identity import Identity, Name, needed
from quadctl.services.runtime.security.registry import LIST

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
"""The messages that a right lets out to who has it."""

_ASK = ["liveliness_query", "declare_liveliness_subscriber"]
_ROLL = ["*/@node/*", "*/@node/*/@pub/**", "*/@node/*/@srv/**"]
"""Who is there may be asked by everybody, of everybody; the answers are what `see` lets out."""
_EVERYWHERE = ["**", "*/@call/**", "*/@srv/**", "*/@node/**", *_ROLL]

_MESSAGES = sorted({m for side in (_FROM, _TO) for messages in side.values() for m in messages})


def access_control(names: Iterable[Name], now: float, link: str) -> dict[str, Any]:
    """Zenoh's `access_control` for the certificates of these names that have not expired by `now`.

    What comes over the protocol `link`, from our own hub, is allowed. Time in Unix s.
    """
    groups: dict[tuple[Role, tuple[str, ...]], list[str]] = {}
    named: set[str] = set()
    for name in names:
        if name.expires > now:
            named.update(name.vehicles)
            groups.setdefault((name.role, tuple(name.vehicles)), []).append(name.common_name)
    everything = [*_MESSAGES, *_ASK]
    rules = [_rule("own", flow, everything, _EVERYWHERE) for flow in ("ingress", "egress")]
    subjects: list[dict[str, Any]] = [{"id": "own", "link_protocols": [link]}]
    policies = [{"rules": [rule["id"] for rule in rules], "subjects": ["own"]}]
    for (role, vehicles), certificates in groups.items():
        subject = f"{role} of {' '.join(vehicles)}"
        granted = [
            *_granted(subject, role, vehicles),
            *_spared(subject, vehicles, named - {EVERY, *vehicles}),
        ]
        rules += granted
        subjects.append({"id": subject, "cert_common_names": certificates})
        policies.append({"rules": [rule["id"] for rule in granted], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _granted(subject: str, role: Role, vehicles: Sequence[str]) -> Iterable[dict[str, Any]]:
    for flow, side in (("ingress", _FROM), ("egress", _TO)):
        for right, messages in side.items():
            if patterns := keys(role, vehicles, right):
                yield _rule(f"{subject} {right}", flow, messages, patterns)
    yield _rule(f"{subject} asks", "ingress", _ASK, _ROLL)
    # That somebody listens, or asks, is told by his pattern, which may cover more than is his.
    if keys(role, vehicles, "publish"):
        yield _rule(f"{subject} is heard", "egress", ["declare_subscriber"], _EVERYWHERE)
    if keys(role, vehicles, "announce"):
        yield _rule(f"{subject} is asked", "egress", _ASK, _EVERYWHERE)
    if role == "hub" and EVERY not in vehicles:
        # Its own people ask for all vehicles too, and are told of theirs.
        yield _rule(f"{subject} listens", "ingress", ["declare_subscriber"], ["**"])


def _spared(subject: str, vehicles: Sequence[str], others: Iterable[str]) -> list[dict[str, Any]]:
    # Of thirty hubs each would be told of all the others' listeners; and his people would take what
    # they say to another's vehicle, which goes nowhere, for heard.
    if EVERY in vehicles:
        return []
    patterns = [f"{other}/{name}" for other in others for name in ("**", "@call/**")]
    message = ["declare_subscriber"]
    return [_rule(f"{subject} is spared", "egress", message, patterns, "deny")] if patterns else []


def _rule(
    about: str, flow: str, messages: list[str], patterns: list[str], permission: str = "allow"
) -> dict[str, Any]:
    return {
        "id": f"{about} {flow}",
        "permission": permission,
        "flows": [flow],
        "messages": messages,
        "key_exprs": sorted(set(patterns)),
    }


def identity_for(endpoints: Sequence[str]) -> Identity:
    """The hub's identity; raises UsageError where it is not given, or is no hub's."""
    who = needed(endpoints[0])
    if who.name.role != "hub":
        raise UsageError(
            f"{endpoints[0]} needs the identity of a hub: {who.folder} is that of the"
            f" {who.name.role} {who.name.name}",
            "`quadctl keys issue hub field` makes one",
        )
    return who


def rules(who: Identity, link: str) -> dict[str, Any]:
    """Zenoh's access control as the list of names has it now; `link` is our own hub's protocol."""
    return access_control(registry.load(Path(who.folder)), time.time(), link)


class RevocationWatch:
    """Tells when the list of names is another one than it was."""

    def __init__(self, folder: str) -> None:
        self._file = Path(folder) / LIST
        self._seen = self._look()

    def changed(self) -> bool:
        """Whether it has changed since the watch began."""
        return self._look() != self._seen

    def _look(self) -> bytes:
        try:
            return self._file.read_bytes()
        except FileNotFoundError:
            return b""
