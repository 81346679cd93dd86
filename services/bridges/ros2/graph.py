"""Names of the ROS graph in Zenoh, as rmw_zenoh 0.2.4 (Jazzy) and later forms them.

A topic or service is the key `0/uav/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3..`:
domain, name, type, hash. `ros2 topic list` reads liveliness tokens, with `%` for `/`:
`@ros2_lv/0/ZID/1/1/NN/%/%uav/quadctl` is a node, and
`@ros2_lv/0/ZID/1/2/MP/%/%uav/quadctl/%uav%pose/TYPE/HASH/::,10:,:,:,,` its publisher.
"""

import struct
from typing import Literal, NamedTuple

import xxhash

Kind = Literal["MP", "MS", "SS"]
"""Publisher, subscriber or server."""

RELIABLE = "::,10:,:,:,,"
"""Quality of service: ROS's defaults; reliable, volatile, the last 10."""
LATCHED = ":1:,1:,:,:,,"
"""Reliable, transient local, the last one."""

_ATTACHMENT = struct.Struct("<qqB16s")
_GID_SIZE = 16


def endpoint_key(domain: int, name: str, type_: str) -> str:
    """Return the key of a topic or service with an absolute name; `type_` is made by type_key."""
    return f"{domain}/{name.strip('/')}/{type_}"


def type_key(type_name: str, digest: str) -> str:
    """Return the part of a key for a type with a hash, e.g. `std_msgs/msg/String`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_/RIHS01_{digest}"


class GraphNode(NamedTuple):
    """Node of the graph: a vehicle's, in the namespace of its name.

    `zid` is the id of the session, `number` the node's id in it.
    """

    domain: int
    zid: str
    number: int
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """Return the liveliness key of the node."""
        return self._token(self.number, "NN")

    def endpoint_token(self, entity: int, kind: Kind, name: str, type_: str, qos: str) -> str:
        """Return the liveliness key of an endpoint; `entity` is its id in the session."""
        mangled = name.replace("/", "%")
        return f"{self._token(entity, kind)}/{mangled}/{type_}/{qos}"

    def _token(self, entity: int, kind: str) -> str:
        place = f"@ros2_lv/{self.domain}/{self.zid}/{self.number}/{entity}/{kind}"
        return f"{place}/%/%{self.namespace}/{self.name}"


def gid_of(token: str) -> bytes:
    """Return the 16 bytes that identify an endpoint; rmw_zenoh makes the same of its token."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(_GID_SIZE, "little")


def attachment(sequence: int, at: int, gid: bytes) -> bytes:
    """Return the attachment of a message: its number, its time (Unix ns) and its sender."""
    return _ATTACHMENT.pack(sequence, at, _GID_SIZE, gid)


def reply_attachment(request: bytes, at: int) -> bytes | None:
    """Return the attachment of a reply at a time (Unix ns); None for a request without a valid one.

    It has the number and the sender of the request, by which the caller finds its call.
    """
    if len(request) != _ATTACHMENT.size:
        return None
    sequence, _, size, gid = _ATTACHMENT.unpack(request)
    return attachment(sequence, at, gid) if size == _GID_SIZE else None
