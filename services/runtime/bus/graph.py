"""The live graph's grammar: who is there and what they offer, told by liveliness alone.

    uav/@node/safety                                               the node is ready
    uav/@node/safety/@pub/SafetyState/1a2b3c4d/1/uav%safety%state  it publishes that at 1 Hz
    uav/@node/safety/@srv/Goto/1a2b3c4d/0/uav%@srv%goto            it answers that service

The last chunk is the full key of the topic or service, `/` written `%`.
"""

from typing import Literal

from msgspec import Struct

Kind = Literal["@pub", "@srv"]


class Offer(Struct, frozen=True):
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


def offer_key(vehicle: str, offer: Offer) -> str:
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


def offer_of(key: str) -> Offer | None:
    """The offer that a liveliness key tells, None where it tells something else.

    Strangers may declare what they like, so a key outside the grammar is no error.
    """
    match key.split("/"):
        case [_, "@node", node, "@pub" | "@srv" as kind, type_, digest, hz, offered]:
            try:
                return Offer(kind, node, type_, digest, float(hz), offered.replace("%", "/"))
            except ValueError:
                return None
    return None
