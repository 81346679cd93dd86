"""Protocol of Foxglove: its JSON documents, its binary frames, and which pages may use them. Pure.

Fields follow https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md; `foxglove.sdk.v1` is
the present name of the same protocol.
"""

import re
from collections.abc import Collection
from struct import Struct as Layout
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.typed import json_decoder
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.errors import Invalid

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
JSON = "json"
"""Encoding of all messages."""

Value = float | int | bool | str | None | list[Any] | dict[str, Any]


def _op(name: str) -> str:
    """Return the `op` of a class, e.g. getParameters of GetParameters."""
    return name[0].lower() + name[1:]


class Document(Struct, frozen=True, tag_field="op", tag=_op, rename="camel"):
    """A JSON document of a client, named in `op`."""


class FoxgloveParameter(Struct, frozen=True, omit_defaults=True):
    """A parameter; without a value it is to be removed."""

    name: str
    value: Value | UnsetType = UNSET
    type: str = ""

    @classmethod
    def of(cls, name: str, value: Any) -> "FoxgloveParameter":
        """Return a parameter with the type of its value: JSON alone writes the float 2.0 as an integer's."""
        if isinstance(value, float):
            return cls(name, value, "float64")
        floats = (
            isinstance(value, list) and value and all(isinstance(each, float) for each in value)
        )
        return cls(name, value, "float64_array" if floats else "")


class ClientSubscription(Struct, frozen=True, rename="camel"):
    """A client's own number for a channel; the frames of its messages have room for 32 bits."""

    id: Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]
    channel_id: int


class Subscribe(Document, frozen=True):
    """Request for the messages of channels."""

    subscriptions: list[ClientSubscription]


class Unsubscribe(Document, frozen=True):
    """End of subscriptions."""

    subscription_ids: list[int]


class ClientChannel(Struct, frozen=True, rename="camel"):
    """A channel on which a client publishes."""

    id: int
    topic: str
    encoding: str = JSON


class ClientAdvertise(Document, frozen=True, tag="advertise"):
    """New channels of a client."""

    channels: list[ClientChannel]


class ClientUnadvertise(Document, frozen=True, tag="unadvertise"):
    """Channels that a client publishes on no longer."""

    channel_ids: list[int]


class GetParameters(Document, frozen=True):
    """Request for the values of parameters, all without a name."""

    parameter_names: list[str] = []
    id: str = ""


class SetParameters(Document, frozen=True):
    """Request to set parameters."""

    parameters: list[FoxgloveParameter]
    id: str = ""


class SubscribeParameterUpdates(Document, frozen=True):
    """Request for changes of parameters, all without a name."""

    parameter_names: list[str] = []


class UnsubscribeParameterUpdates(Document, frozen=True):
    """End of such a request."""

    parameter_names: list[str] = []


class SubscribeConnectionGraph(Document, frozen=True):
    """Request for the connection graph."""


class UnsubscribeConnectionGraph(Document, frozen=True):
    """End of such a request."""


class ClientMessage(NamedTuple):
    """Message that a client publishes."""

    channel: int
    data: bytes


class ServiceCall(NamedTuple):
    """Call of a service."""

    service: int
    number: int
    encoding: str
    payload: bytes


Request = (
    Subscribe
    | Unsubscribe
    | ClientAdvertise
    | ClientUnadvertise
    | GetParameters
    | SetParameters
    | SubscribeParameterUpdates
    | UnsubscribeParameterUpdates
    | SubscribeConnectionGraph
    | UnsubscribeConnectionGraph
)

_request = json_decoder(Request)
_MESSAGE, _CALL, _RESPONSE = 1, 2, 3
_message, _published, _call = Layout("<BIQ"), Layout("<BI"), Layout("<BIII")


def request_of(data: str | bytes) -> Request | ClientMessage | ServiceCall:
    """Return what a client sent; raise Invalid for garbage."""
    if isinstance(data, str):
        try:
            request: Request = _request.decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise Invalid(f"not a request of Foxglove: {error}") from error
        return request
    kind = data[0] if data else 0
    if kind == _MESSAGE and len(data) >= _published.size:
        return ClientMessage(_published.unpack_from(data)[1], data[_published.size :])
    if kind == _CALL and len(data) >= _call.size:
        _, service, number, length = _call.unpack_from(data)
        start = _call.size + length
        if start <= len(data):
            encoding = data[_call.size : start].decode("ascii", "replace")
            return ServiceCall(service, number, encoding, data[start:])
    raise Invalid(f"not a frame of Foxglove: {len(data)} bytes that begin with {data[:8].hex()}")


def document(op: str, **fields: Any) -> str:
    """Return a document of ours; a field with an empty text is left out."""
    given = {name: value for name, value in fields.items() if value != ""}
    return msgspec.json.encode({"op": op, **given}).decode()


def schema(type_: type[Struct] | None, package: str = "quadctl") -> dict[str, str]:
    """Return a type as the protocol describes it, None for a user's own JSON; viewers need a schema."""
    name, text = "json", '{"type": "object", "properties": {}}'
    if type_ is not None:
        name = f"{package}.{type_.__name__}"
        text = msgspec.json.encode(json_schema(type_)).decode()
    return {"schemaName": name, "schema": text, "schemaEncoding": "jsonschema"}


def message_frame(subscription: int, at: int, data: bytes) -> bytes:
    """Return the frame of a message that came at a Unix time, ns."""
    return _message.pack(_MESSAGE, subscription, at) + data


def response_frame(call: ServiceCall, payload: bytes) -> bytes:
    """Return the frame of a response."""
    encoding = JSON.encode()
    head = _call.pack(_RESPONSE, call.service, call.number, len(encoding))
    return head + encoding + payload


class Graph(NamedTuple):
    """Nodes by topic and service: who publishes, who subscribes, who serves."""

    published: dict[str, list[str]]
    subscribed: dict[str, list[str]]
    served: dict[str, list[str]]

    @classmethod
    def of(cls, endpoints: Collection[EndpointInfo]) -> "Graph":
        """Return the graph of the nodes' endpoints; services have the names of the bridge's."""
        graph = cls({}, {}, {})
        for each in endpoints:
            node = f"{each.vehicle}/{each.node}"
            if each.kind == "@srv":
                graph.served.setdefault(f"{each.vehicle}/{each.name}", []).append(node)
            else:
                table = graph.published if each.kind == "@pub" else graph.subscribed
                table.setdefault(each.key, []).append(node)
        return graph

    def update(self, before: "Graph") -> dict[str, Any]:
        """Return the fields of connectionGraphUpdate for a client that has the graph as it was before."""
        topics, known = (g.published.keys() | g.subscribed.keys() for g in (self, before))
        # A topic without publishers may still have subscribers.
        published, subscribed = (
            {key: new.get(key, []) for key in (*old, *new)}
            for old, new in zip(before[:2], self[:2], strict=True)
        )
        return {
            "publishedTopics": _nodes(published, "publisherIds"),
            "subscribedTopics": _nodes(subscribed, "subscriberIds"),
            "advertisedServices": _nodes(self.served, "providerIds"),
            "removedTopics": sorted(known - topics),
            "removedServices": sorted(before.served.keys() - self.served.keys()),
        }


def _nodes(table: dict[str, list[str]], ids: str) -> list[dict[str, Any]]:
    return [{"name": name, ids: nodes} for name, nodes in table.items()]


_APP = "https://app.foxglove.dev"
_LOCAL = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
_WEB = re.compile(r"https?://|null$", re.IGNORECASE)


def may_watch(origin: str, allowed: Collection[str]) -> bool:
    """Return whether a page of an origin may connect: any site that a user visits could try to.

    Programs send no origin, and desktop apps one that no site has. A page of this machine may, that
    of Foxglove, and the `allowed` ones. A site can have the origin `null`.
    """
    named = {each.lower().rstrip("/") for each in allowed}
    if not _WEB.match(origin) or origin == _APP or origin.lower() in named:
        return True
    return _LOCAL.fullmatch(origin) is not None
