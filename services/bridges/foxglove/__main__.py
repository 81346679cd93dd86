"""Process of the bridge to Foxglove and Lichtblick: one WebSocket server for all its vehicles.

Clients may act only with the token in QUADCTL_FOXGLOVE_TOKEN.
"""

import time
from collections.abc import Iterable
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas.messages import SafetyState
from quadctl.schemas.params import Params
from quadctl.schemas.topics import SERVICES, STATE, TOPICS, Service, topic_of
from quadctl.services.bridges.base import BridgedVehicle, run_bridge
from quadctl.services.bridges.foxglove.client import Channel
from quadctl.services.bridges.foxglove.protocol import JSON, schema
from quadctl.services.bridges.foxglove.server import FoxgloveServer, Message
from quadctl.services.bridges.foxglove.translation import readable
from quadctl.services.bridges.foxglove.vehicles import Vehicles
from quadctl.services.bridges.options import FoxgloveOptions
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.recording.mcap_format import Form
from quadctl.services.runtime.recording.scene import (
    FRAMES_KEY,
    SCENE_KEY,
    Drawing,
    FrameTransform,
    SceneUpdate,
)
from quadctl.services.runtime.security.endpoints import url_host

_MOST_TOPICS = 2000
"""Topics of a vehicle that are shown."""


class FoxgloveBridge:
    """Server for the vehicles, and the channels that they share."""

    def __init__(self, options: FoxgloveOptions) -> None:
        self._options, self._vehicles = options, Vehicles()
        self._drawings: list[Drawing] = []

    def open(self, node: Node) -> None:
        """Listen; raise the error of a wrong option."""
        given = self._options
        token, tls, listening = given.token, given.tls, given.bound()
        self.server = FoxgloveServer(self._vehicles, node.log, token=token, origins=given.origins)
        self.server.open(listening, tls)
        may = "may act, with the token" if token else "may only watch"
        scheme = "wss" if tls else "ws"
        host = url_host(given.host)
        node.log.info("serving %s://%s:%d; clients %s", scheme, host, given.port, may)
        channel = self.server.channel
        self.frames = channel(FRAMES_KEY, schema(FrameTransform, "foxglove"))
        self.scene = channel(SCENE_KEY, schema(SceneUpdate, "foxglove"), self._whole_scene)

    def _whole_scene(self) -> Iterable[tuple[bytes, int]]:
        for drawing in tuple(self._drawings):
            if scene := drawing.whole(at := time.time_ns()):
                yield _json(scene), at

    def add(self, node: Node, _params: Params) -> None:
        """Offer the topics and services of a vehicle."""
        vehicle = self._vehicles[node.vehicle] = ShownVehicle(self, node)
        self._drawings.append(vehicle.drawing)
        self.server.offer(_offered(vehicle.name, each) for each in SERVICES)
        vehicle.listen()


class ShownVehicle(BridgedVehicle):
    """Vehicle as the server shows it; its messages are handled on Zenoh's one thread."""

    def __init__(self, bridge: FoxgloveBridge, node: Node) -> None:
        super().__init__(node)
        self.drawing, self._bridge = Drawing(node.vehicle), bridge
        self._routes: dict[tuple[str, str], Route] = {}
        self._channels: dict[tuple[str, type[Struct] | None], Channel] = {}
        self._state = STATE.key(node.vehicle)
        for topic in TOPICS:  # before their first messages
            self._channel(topic.key(self.name), topic.type)

    def listen(self) -> None:
        """Subscribe to all topics and calls of the vehicle."""
        keys = (f"{self.name}/**", f"{self.name}/@call/**")
        self._listener = listener = self.node.listen_raw(keys, self._show)
        for topic in TOPICS:
            if topic.latched:
                listener.request_latched(topic.key(self.name))

    def _channel(self, key: str, type_: type[Struct] | None) -> Channel:
        """Return the channel of a key's messages of one type, None for a user's own."""
        kind = key, type_
        if kind not in self._channels:
            self._channels[kind] = self._bridge.server.channel(key, schema(type_))
        return self._channels[kind]

    def _show(self, message: RawMessage) -> None:
        kind, frames = (message.key, message.encoding), self._bridge.frames
        route = self._routes.get(kind)
        if route is None:
            if len(self._routes) >= _MOST_TOPICS:
                self._routes.clear()
            route = self._routes[kind] = Route(*kind)
        elif route.is_quiet and not (frames.subscribers or route.channel.subscribers):
            return
        stored = route.form.stored(message.payload)
        if route.type is not stored.type:
            if len(self._channels) >= _MOST_TOPICS:
                # E.g. a node that publishes on a new key each time.
                return
            route.type, route.channel = stored.type, self._channel(message.key, stored.type)
        data = stored.data if stored.encoding == JSON else readable(message.payload, kind[1])
        messages: list[Message] = [(route.channel, data, message.at)]
        if route.latched:
            route.channel.last = data, message.at
        if isinstance(stored.message, SafetyState) and message.key == self._state:
            self.see(stored.message)
            self._bridge.server.refresh("graph")
        elif route.sets_parameters:
            self.parameters.forget()
            self._bridge.server.refresh("parameters")
        if derived := self.drawing.derive(message.key, stored.message, message.at):
            channel = frames if derived.key == FRAMES_KEY else self._bridge.scene
            if channel.subscribers:
                messages.append((channel, _json(derived.message), message.at))
        if wanted := [each for each in messages if each[0].subscribers]:
            self._bridge.server.publish(wanted)


class Route:
    """Way of the messages of one key and one Zenoh encoding to their channel.

    Found once: after each pause of 10 ms the processor's caches are cold, and every lookup counts.
    """

    channel: Channel

    def __init__(self, key: str, encoding: str) -> None:
        self.form, topic = Form(key, encoding), topic_of(key)
        self.type: type[Struct] | None = Struct
        """Type of the channel's messages; none has this one."""
        self.latched = topic is not None and topic.latched
        self.sets_parameters = key.endswith("/set_params")
        # Only subscribers need such a message.
        self.is_quiet = not self.latched and not self.sets_parameters


_json = msgspec.json.encode


def _offered(vehicle: str, service: Service[Any, Any]) -> dict[str, Any]:
    """Return a service of a vehicle as the protocol describes it."""
    request, response = (
        schema(each) | {"encoding": JSON} for each in (service.request, service.response)
    )
    name, type_ = f"{vehicle}/{service.name}", f"quadctl.{service.type_name}"
    return {"name": name, "type": type_, "request": request, "response": response}


if __name__ == "__main__":
    run_bridge("foxglove", FoxgloveOptions, FoxgloveBridge)
