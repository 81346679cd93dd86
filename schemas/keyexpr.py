"""Keys on the wire: the liveliness grammar, and key-expression inclusion without Zenoh.

    uav/@node/safety                                               the node is ready
    uav/@node/safety/@pub/SafetyState/1a2b3c4d/1/uav%safety%state  a topic of it, at 1 Hz
    uav/@node/safety/@srv/Goto/1a2b3c4d/0/uav%@srv%goto            a service of it
    uav/@node/safety/@sub/Pose/1a2b3c4d/20/uav%pose%slow           a topic that it subscribes to

The last chunk is the full key of the topic or service, `/` written `%`.
"""

from functools import cache
from typing import Literal

from msgspec import Struct

Kind = Literal["@pub", "@srv", "@sub"]


class EndpointInfo(Struct, frozen=True):
    """Topic or service that a live node of a vehicle offers or uses, on a full Zenoh key."""

    vehicle: str
    kind: Kind
    node: str
    type: str
    hash: str
    hz: float
    key: str

    @property
    def name(self) -> str:
        """Return the key without the common prefix of its vehicle and kind."""
        return self.key.partition("/")[2].removeprefix("@srv/")


def node_key(vehicle: str, node: str) -> str:
    """Return the liveliness key of a ready node."""
    return f"{vehicle}/@node/{node}"


def endpoint_key(offer: EndpointInfo) -> str:
    """Return the liveliness key of an endpoint."""
    key = offer.key.replace("/", "%")
    offered = f"{offer.kind}/{offer.type}/{offer.hash}/{offer.hz:g}/{key}"
    return f"{node_key(offer.vehicle, offer.node)}/{offered}"


def vehicle_of(key: str) -> str:
    """Return the vehicle of a liveliness key."""
    return key.partition("/")[0]


def node_of(key: str) -> str | None:
    """Return the node of a readiness key, None for other liveliness keys."""
    match key.split("/"):
        case [_, "@node", node]:
            return node
    return None


def offer_of(key: str) -> EndpointInfo | None:
    """Return a liveliness key's endpoint, None for others: third parties may declare any key."""
    match key.split("/"):
        case [vehicle, "@node", node, "@pub" | "@srv" | "@sub" as kind, type_, digest, hz, offered]:
            key = offered.replace("%", "/")
            try:
                return EndpointInfo(vehicle, kind, node, type_, digest, float(hz), key)
            except ValueError:
                return None
    return None


def includes(pattern: str, key: str) -> bool:
    """Return whether the pattern matches all keys of `key`, which may be an expression itself.

    `*` is one chunk, `**` any number of chunks, `$*` any part of a chunk. None of these matches a
    chunk that begins with `@`: only the same chunk does.
    """
    return _chunks(tuple(pattern.split("/")), tuple(key.split("/")))


@cache
def _chunks(pattern: tuple[str, ...], key: tuple[str, ...]) -> bool:
    if not pattern:
        return not key
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        # No chunk, or one more.
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
    """Match character by character; `$*` matches any, and a `$*` of the chunk as a unit."""
    if not pattern:
        return not chunk
    if pattern.startswith("$*"):
        if _parts(pattern[2:], chunk):
            return True
        size = 2 if chunk.startswith("$*") else 1
        return bool(chunk) and _parts(pattern, chunk[size:])
    if not chunk or chunk.startswith("$*"):
        return False
    return pattern[0] == chunk[0] and _parts(pattern[1:], chunk[1:])
