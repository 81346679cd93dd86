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
from quadctl.services.runtime.errors import Invalid

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
JSON, JSON_SCHEMA = "json", "jsonschema"
"""Encodings of all messages, and of all schemas."""
ERROR = 2
"""Level of a status that reports a problem."""

Value = float | int | bool | str | None | list[Any] | dict[str, Any]


def _op(name: str) -> str:
    """Return the `op` of a class, e.g. serverInfo of ServerInfo."""
    return name[0].lower() + name[1:]


class Document(Struct, frozen=True, tag_field="op", tag=_op, rename="camel", omit_defaults=True):
    """A JSON document of either side, named in `op`."""


class ServerInfo(Document, frozen=True):
    """Name and abilities of the server: the first document of a connection."""

    name: str
    capabilities: list[str]
    supported_encodings: list[str]
    session_id: str


class Status(Document, frozen=True):
    """A remark for the user; a later one with the same `id` replaces it."""

    level: int
    message: str
    id: str = ""


class RemoveStatus(Document, frozen=True):
    """End of what a status has reported."""

    status_ids: list[str]


class Advertised(Struct, frozen=True, rename="camel"):
    """A channel of the server."""

    id: int
    topic: str
    encoding: str
    schema_name: str
    schema: str
    schema_encoding: str


class Advertise(Document, frozen=True):
    """New channels of the server."""

    channels: list[Advertised]


class Schema(Struct, frozen=True, rename="camel"):
    """Schema of a request or of a response."""

    schema_name: str
    schema: str
    encoding: str = JSON
    schema_encoding: str = JSON_SCHEMA


class Offered(Struct, frozen=True):
    """A service of the server."""

    id: int
    name: str
    type: str
    request: Schema
    response: Schema


class AdvertiseServices(Document, frozen=True):
    """New services of the server."""

    services: list[Offered]


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


class ParameterValues(Document, frozen=True):
    """Values of parameters; `id` is that of the request."""

    parameters: list[FoxgloveParameter]
    id: str = ""


class ServiceCallFailure(Document, frozen=True):
    """Answer to a call that failed."""

    service_id: int
    call_id: int
    message: str


class PublishedTopic(Struct, frozen=True, rename="camel"):
    """A topic and its publishers."""

    name: str
    publisher_ids: list[str]


class SubscribedTopic(Struct, frozen=True, rename="camel"):
    """A topic and its subscribers."""

    name: str
    subscriber_ids: list[str]


class AdvertisedService(Struct, frozen=True, rename="camel"):
    """A service and its providers."""

    name: str
    provider_ids: list[str]


class ConnectionGraphUpdate(Document, frozen=True, omit_defaults=False):
    """Which nodes publish, subscribe and serve; entries replace those of the same name."""

    published_topics: list[PublishedTopic]
    subscribed_topics: list[SubscribedTopic]
    advertised_services: list[AdvertisedService]
    removed_topics: list[str]
    removed_services: list[str]


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

encode = msgspec.json.encode
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

    def update(self, before: "Graph") -> ConnectionGraphUpdate:
        """Return the document for a client that has the graph as it was before."""
        topics, known = (g.published.keys() | g.subscribed.keys() for g in (self, before))
        # A topic without publishers may still have subscribers.
        published, subscribed = (
            {key: new.get(key, []) for key in (*old, *new)}
            for old, new in zip(before[:2], self[:2], strict=True)
        )
        return ConnectionGraphUpdate(
            [PublishedTopic(*each) for each in published.items()],
            [SubscribedTopic(*each) for each in subscribed.items()],
            [AdvertisedService(*each) for each in self.served.items()],
            sorted(known - topics),
            sorted(before.served.keys() - self.served.keys()),
        )


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
