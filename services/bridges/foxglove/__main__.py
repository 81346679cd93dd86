"""Process of the bridge to Foxglove and Lichtblick: one WebSocket server for all its vehicles.

Clients may act only with the token in QUADCTL_FOXGLOVE_TOKEN.
"""

import contextlib
import time
from collections.abc import Collection, Iterable
from functools import partial
from typing import Any

import msgspec
from msgspec import UNSET, Struct

from quadctl.schemas.messages import SafetyState
from quadctl.schemas.params import Params
from quadctl.schemas.topics import SERVICES, STATE, TOPICS, Service, topic_of
from quadctl.schemas.typed import from_json
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.bridges.base import AGE, BridgedVehicle, run_bridge
from quadctl.services.bridges.foxglove.protocol import FoxgloveParameter, Graph, Offered, Schema
from quadctl.services.bridges.foxglove.server import FoxgloveServer, Message
from quadctl.services.bridges.foxglove.translation import (
    by_node,
    readable,
    request_of,
    to_ours,
)
from quadctl.services.bridges.options import FoxgloveOptions
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.recording.mcap_format import JSON, Form
from quadctl.services.runtime.recording.scene import (
    FRAMES_KEY,
    SCENE,
    SCENE_KEY,
    TRANSFORM,
    Drawing,
    FrameTransform,
    SceneUpdate,
)
from quadctl.services.runtime.security.endpoints import url_host

GOALS = "/goto"
"""Topic of published goals; of several vehicles each has its own, e.g. `/uav1/goto`."""
_MOST_TOPICS = 2000
"""Topics of a vehicle that are shown."""
_FREE = '{"type": "object", "properties": {}}'
"""Schema of a user's own JSON; viewers need one."""


class FoxgloveBridge:
    """Vehicles behind the server, and the channels that they share."""

    def __init__(self, options: FoxgloveOptions) -> None:
        self._options = options
        self._vehicles: dict[str, ShownVehicle] = {}

    def open(self, node: Node) -> None:
        """Listen; raise the error of a wrong option."""
        given = self._options
        token, tls, listening = given.token, given.tls, given.bound()
        self.server = FoxgloveServer(self, node.log, token=token, origins=given.origins)
        self.server.open(listening, tls)
        may = "may act, with the token" if token else "may only watch"
        scheme = "wss" if tls else "ws"
        host = url_host(given.host)
        node.log.info("serving %s://%s:%d; clients %s", scheme, host, given.port, may)
        channel = self.server.channel
        self.frames = channel(FRAMES_KEY, TRANSFORM, _schema(FrameTransform), tuple)
        self.scene = channel(SCENE_KEY, SCENE, _schema(SceneUpdate), self._whole_scene)

    def _whole_scene(self) -> Iterable[tuple[bytes, int]]:
        for vehicle in tuple(self._vehicles.values()):
            if scene := vehicle.drawing.whole(at := time.time_ns()):
                yield _json(scene), at

    def add(self, node: Node, _params: Params) -> None:
        """Offer the topics and services of a vehicle."""
        vehicle = self._vehicles[node.vehicle] = ShownVehicle(self, node)
        self.server.offer(partial(_offered, vehicle.name, each) for each in SERVICES)
        vehicle.listen()

    def call(self, service: str, payload: bytes) -> bytes:
        """Call a service of a vehicle, by its offered name, with JSON; return its response."""
        vehicle, _, name = service.partition("/")
        found = next(each for each in SERVICES if each.name == name)
        try:
            request = from_json(payload or b"{}", found.request)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            hint = f"`quadctl type show {name}` prints its fields"
            raise Invalid(f"not a valid request of {name}: {error}", hint) from error
        return _json(self._vehicles[vehicle].call(found, request))

    def check_goals(self, topic: str) -> None:
        """Raise Invalid if no vehicle flies to the goals of a topic."""
        self._flown_by(topic)

    def fly(self, topic: str, data: bytes) -> None:
        """Fly to a published goal."""
        vehicle = self._flown_by(topic)
        vehicle.fly(request_of(data, vehicle.height))

    def _flown_by(self, topic: str) -> "ShownVehicle":
        vehicles = {f"/{name}{GOALS}": vehicle for name, vehicle in self._vehicles.items()}
        if len(vehicles) == 1:
            vehicles[GOALS] = next(iter(vehicles.values()))
        if topic not in vehicles:
            raise Invalid(f"nobody takes {topic}", f"publish to one of {', '.join(vehicles)}")
        return vehicles[topic]

    def parameters(self, names: Collection[str]) -> list[FoxgloveParameter]:
        """Return the parameters with these names, all without any."""
        found = {
            f"{vehicle.name}.{name}": value
            for vehicle in tuple(self._vehicles.values())
            for name, value in vehicle.parameters.read(AGE).items()
        }
        wanted = dict.fromkeys(names) or found
        return [FoxgloveParameter.of(name, found[name]) for name in wanted if name in found]

    def set_parameters(self, parameters: Iterable[FoxgloveParameter]) -> None:
        """Set parameters, of each node all or none; raise what the last node in vain raised."""
        problem: QuadctlError | None = None
        given = {each.name: each.value for each in parameters}
        if missing := [name for name, value in given.items() if value is UNSET]:
            raise Invalid(f"{missing[0]} has no value", "a parameter cannot be removed")
        for (vehicle, _), changes in by_node(given).items():
            try:
                if vehicle not in self._vehicles:
                    hint = f"one of {', '.join(self._vehicles)}"
                    raise Invalid(f"there is no vehicle {vehicle}", hint)
                self._vehicles[vehicle].set_parameters(changes)
            except QuadctlError as refusal:
                problem = refusal
        if problem:
            raise problem

    def graph(self) -> Graph:
        """Return the present connection graph."""
        endpoints = []
        for vehicle in tuple(self._vehicles.values()):
            with contextlib.suppress(QuadctlError):
                endpoints += vehicle.endpoints()
        return Graph.of(endpoints)


class ShownVehicle(BridgedVehicle):
    """Vehicle as the server shows it; its messages are handled on Zenoh's one thread."""

    def __init__(self, bridge: FoxgloveBridge, node: Node) -> None:
        super().__init__(node)
        self.drawing, self.endpoints = Drawing(node.vehicle), node.endpoints
        self._bridge = bridge
        self._routes: dict[tuple[str, str], Route] = {}
        self._channels: dict[tuple[str, type[Struct] | None], ShownTopic] = {}
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

    def set_parameters(self, changes: dict[str, Any]) -> None:
        """Set parameters of one node, all or none; raise QuadctlError if they are refused."""
        present = self.parameters.read()
        self.parameters.set(
            {name: to_ours(each, present.get(name)) for name, each in changes.items()}
        )

    def _channel(self, key: str, type_: type[Struct] | None) -> "ShownTopic":
        """Return the channel of a key's messages of one type, None for a user's own."""
        kind = key, type_
        if kind not in self._channels:
            self._channels[kind] = ShownTopic(self._bridge.server, key, type_)
        return self._channels[kind]

    def _show(self, message: RawMessage) -> None:
        kind, frames = (message.key, message.encoding), self._bridge.frames
        route = self._routes.get(kind)
        if route is None:
            if len(self._routes) >= _MOST_TOPICS:
                self._routes.clear()
            route = self._routes[kind] = Route(*kind)
        elif route.is_quiet and not (frames.subscribers or route.topic.channel.subscribers):
            return
        stored = route.form.stored(message.payload)
        if route.type is not stored.type:
            if len(self._channels) >= _MOST_TOPICS:
                # E.g. a node that publishes on a new key each time.
                return
            route.type, route.topic = stored.type, self._channel(message.key, stored.type)
        data = stored.data if stored.encoding == JSON else readable(message.payload, kind[1])
        messages: list[Message] = [(route.topic.channel, data, message.at)]
        if route.latched:
            route.topic.last = data, message.at
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


class ShownTopic:
    """Channel of a key's messages of one type, and the last one of a latched topic."""

    def __init__(self, server: FoxgloveServer, key: str, type_: type[Struct] | None) -> None:
        self.last: tuple[bytes, int] | None = None
        name = "json" if type_ is None else f"quadctl.{type_.__name__}"
        schema = _FREE if type_ is None else _schema(type_)
        self.channel = server.channel(key, name, schema, self._latest)

    def _latest(self) -> Iterable[tuple[bytes, int]]:
        return [self.last] if self.last else []


class Route:
    """Way of the messages of one key and one Zenoh encoding to their channel.

    Found once: after each pause of 10 ms the processor's caches are cold, and every lookup counts.
    """

    topic: ShownTopic

    def __init__(self, key: str, encoding: str) -> None:
        self.form, topic = Form(key, encoding), topic_of(key)
        self.type: type[Struct] | None = Struct
        """Type of the channel's messages; none has this one."""
        self.latched = topic is not None and topic.latched
        self.sets_parameters = key.endswith("/set_params")
        # Only subscribers need such a message.
        self.is_quiet = not self.latched and not self.sets_parameters


_json = msgspec.json.encode


def _schema(type_: type[Struct]) -> str:
    return _json(json_schema(type_)).decode()


def _offered(vehicle: str, service: Service[Any, Any], number: int) -> Offered:
    request, response = (
        Schema(f"quadctl.{each.__name__}", _schema(each))
        for each in (service.request, service.response)
    )
    type_ = f"quadctl.{service.type_name}"
    return Offered(number, f"{vehicle}/{service.name}", type_, request, response)


if __name__ == "__main__":
    run_bridge("foxglove", FoxgloveOptions, FoxgloveBridge)
