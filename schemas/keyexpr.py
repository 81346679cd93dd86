"""Keys on the wire: the liveliness grammar, and key-expression inclusion without Zenoh.

    uav/@node/safety                                               the node is ready
    uav/@node/safety/@pub/SafetyState/1a2b3c4d/1/uav%safety%state  a topic of it, at 1 Hz
    uav/@node/safety/@srv/Goto/1a2b3c4d/0/uav%@srv%goto            a service of it

The last chunk is the full key of the topic or service, `/` written `%`.
"""

from functools import cache
from typing import Literal

from msgspec import Struct

Kind = Literal["@pub", "@srv"]


class EndpointInfo(Struct, frozen=True):
    """One topic or service that a live node offers, on a full Zenoh key."""

    kind: Kind
    node: str
    type: str
    hash: str
    hz: float
    key: str

    @property
    def name(self) -> str:
        """The key without what every key of its vehicle and kind begins with."""
        return self.key.partition("/")[2].removeprefix("@srv/")


def node_key(vehicle: str, node: str) -> str:
    """The liveliness key of a ready node."""
    return f"{vehicle}/@node/{node}"


def endpoint_key(vehicle: str, offer: EndpointInfo) -> str:
    """The liveliness key of an offer."""
    key = offer.key.replace("/", "%")
    offered = f"{offer.kind}/{offer.type}/{offer.hash}/{offer.hz:g}/{key}"
    return f"{node_key(vehicle, offer.node)}/{offered}"


def vehicle_of(key: str) -> str:
    """The vehicle that a liveliness key is about."""
    return key.partition("/")[0]


def node_of(key: str) -> str | None:
    """The node whose readiness a liveliness key tells, None where it tells something else."""
    match key.split("/"):
        case [_, "@node", node]:
            return node
    return None


def offer_of(key: str) -> EndpointInfo | None:
    """The offer that a liveliness key tells, None where it tells something else.

    Strangers may declare what they like, so a key outside the grammar is no error.
    """
    match key.split("/"):
        case [_, "@node", node, "@pub" | "@srv" as kind, type_, digest, hz, offered]:
            try:
                return EndpointInfo(kind, node, type_, digest, float(hz), offered.replace("%", "/"))
            except ValueError:
                return None
    return None


def includes(pattern: str, key: str) -> bool:
    """Whether every key that `key`, itself perhaps an expression, stands for fits the pattern.

    `*` is one chunk, `**` any number of them, `$*` any part of one. None of these stands for a chunk
    that begins with `@`: such a one is matched by itself alone.
    """
    return _chunks(tuple(pattern.split("/")), tuple(key.split("/")))


@cache
def _chunks(pattern: tuple[str, ...], key: tuple[str, ...]) -> bool:
    if not pattern:
        return not key
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        # Of no chunk, or of one more.
        more = bool(key) and not key[0].startswith("@") and _chunks(pattern, key[1:])
        return more or _chunks(rest, key)
    if not key:
        return False
    return _chunk(first, key[0]) and _chunks(rest, key[1:])


def _chunk(pattern: str, chunk: str) -> bool:
    if pattern == chunk:
        return True
    if chunk == "**" or chunk.startswith("@") or pattern.startswith("@"):
        return False
    if pattern == "*":
        return True
    if chunk == "*":
        return pattern == "$*"
    return "$*" in pattern and _parts(pattern, chunk)


@cache
def _parts(pattern: str, chunk: str) -> bool:
    """Character by character; `$*` stands for any of them, a `$*` of the chunk for itself too."""
    if not pattern:
        return not chunk
    if pattern.startswith("$*"):
        if _parts(pattern[2:], chunk):
            return True
        taken = 2 if chunk.startswith("$*") else 1
        return bool(chunk) and _parts(pattern, chunk[taken:])
    if not chunk or chunk.startswith("$*"):
        return False
    return pattern[0] == chunk[0] and _parts(pattern[1:], chunk[1:])
