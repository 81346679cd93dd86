"""Process of the bridge to Foxglove and Lichtblick: one WebSocket server for all its vehicles.

python -P -m quadctl.services.foxglove [--port 8765] [--control]

It holds no safety logic: a goal, a call or a parameter goes the way of our own services, and is
refused by them.
"""

import argparse
import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import TimeoutError as NotInTime
from functools import partial
from typing import Any

import foxglove
import msgspec
from foxglove import Channel
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    ClientChannel,
    ConnectionGraph,
    MessageSchema,
    Parameter,
    ServerListener,
    ServiceRequest,
    ServiceSchema,
    StatusLevel,
)
from foxglove.websocket import Service as Offered
from msgspec import Struct

from quadctl.schemas.messages import SafetyState
from quadctl.schemas.params import Params
from quadctl.schemas.services import GetParamsRequest, SetParamsRequest
from quadctl.schemas.topics import (
    GOTO,
    SERVICES,
    SETPOINT,
    TOPICS,
    Service,
    get_params,
    set_params,
    topic_of,
)
from quadctl.services.foxglove.channels import Channels, schema_of
from quadctl.services.foxglove.translation import (
    Graph,
    by_node,
    goal_of,
    graph_of,
    readable,
    service_name,
    to_ours,
)
from quadctl.services.foxglove.worker import CallWorker
from quadctl.services.runtime.bus.raw import RawMessage
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.recording.mcap_format import JSON, Form
from quadctl.services.runtime.recording.scene import Drawing

NAME = "foxglove"
PORT = 8765
HOST = "127.0.0.1"
GOALS = "/goto"
"""Topic of published goals; of several vehicles each has its own, e.g. `/uav1/goto`."""
_READ_ONLY = Refused(
    "the bridge only shows the vehicle", "start it with `quadctl bridge foxglove --control`"
)
_NODES = ("dynamics", "pressure", "safety")
"""Nodes with parameters."""

_TIMEOUT = 3.0
"""Seconds that a call to one of our services may take."""
_PATIENCE = 1.0
"""Seconds that a client waits for parameters: meanwhile it blocks a thread of the SDK."""


def main() -> None:
    """Parse the options that only the bridge has, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--port", type=int, default=PORT)
    parser.add_argument("--control", action="store_true")
    options, sys.argv[1:] = parser.parse_known_args()
    start(NAME, partial(run, FoxgloveServer(options.port, control=options.control)))


def run(server: "FoxgloveServer", node: Node, _params: Params) -> None:
    """Bridge one vehicle until stopped."""
    vehicle = ShownVehicle(server, node)
    if node.is_first:
        server.open()
        node.log.info("serving ws://%s:%d", HOST, server.port)
    server.add(vehicle)
    vehicle.listen()
    node.spin()


class Failure(Exception):
    """Failure of a call, named and worded for the person who made it."""


class FoxgloveServer(ServerListener):
    """WebSocket server with the channels and services of all vehicles.

    The SDK calls `on_..` on its own threads; these must not block for long.
    """

    def __init__(self, port: int, *, control: bool) -> None:
        self.port, self._control = port, control
        self.channels = Channels()
        self._vehicles: dict[str, ShownVehicle] = {}
        self._advertised: dict[tuple[int, int], str] = {}
        self._worker = CallWorker()
        self._graph_wanted, self._graph = False, Graph({}, {}, {})

    def open(self) -> None:
        """Listen; raise QuadctlError if another process has the port."""
        # The SDK reports every client that comes and goes.
        logging.getLogger("foxglove").setLevel(logging.WARNING)
        try:
            self._server = foxglove.start_server(
                name="quadctl",
                host=HOST,
                port=self.port,
                capabilities=[
                    Capability.ClientPublish,
                    Capability.ConnectionGraph,
                    Capability.Parameters,
                    Capability.Services,
                ],
                server_listener=self,
                supported_encodings=[JSON],
                context=self.channels.context,
            )
        except RuntimeError as error:  # of the SDK
            raise QuadctlError(
                f"port {self.port} cannot be opened: {error}",
                f"end the program that has it, or choose another: --port {self.port + 1}",
            ) from error
        self.port = self._server.port

    def add(self, vehicle: "ShownVehicle") -> None:
        """Offer the topics and services of a vehicle."""
        self._vehicles[vehicle.name] = vehicle
        self.channels.add(vehicle.name, vehicle.drawing)
        self._server.add_services([self._offer(vehicle, each) for each in SERVICES])

    def submit(self, job: Callable[[], None]) -> None:
        """Execute a job on the thread that may block; raise Refused if too many wait."""
        self._worker.submit(job)

    def later(self, job: Callable[[], None]) -> None:
        """Execute a job on the thread that may block, unless too many wait."""
        with contextlib.suppress(Refused):
            self._worker.submit(job)

    def show_graph(self) -> None:
        """Publish the connection graph if a client has subscribed to it."""
        if self._graph_wanted:
            self.later(self._publish_graph)

    def show_parameters(self, vehicle: "ShownVehicle") -> None:
        """Read a vehicle's parameters, and publish them to the clients that subscribe to them."""
        self.later(lambda: self._publish_parameters(vehicle))

    def complain(self, topic: str, problem: QuadctlError | None) -> None:
        """Show a problem to all clients until it is over, which None means."""
        if problem is None:
            self._server.remove_status([topic])
        else:
            self._server.publish_status(_text(problem), StatusLevel.Error, topic)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send the last state, or the whole scene, to a late subscriber."""
        self.channels.welcome(client, channel)

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        """Take a topic on which a client will publish goals, or show why it cannot."""
        self._advertised[client.id, channel.id] = channel.topic
        try:
            self._vehicle_of(channel.topic)
        except QuadctlError as problem:
            self.later(partial(self.complain, channel.topic, problem))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        """Forget a topic of a client, and what was wrong with it."""
        if topic := self._advertised.pop((client.id, client_channel_id), None):
            self.later(partial(self.complain, topic, None))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        """Fly to a published goal."""
        with contextlib.suppress(QuadctlError):  # shown since it was advertised
            topic = self._advertised.get((client.id, client_channel_id), "")
            self._vehicle_of(topic).on_goal(topic, data)

    def on_get_parameters(
        self, _client: Client, param_names: list[str], _request_id: str | None = None
    ) -> list[Parameter]:
        """Return the parameters with these names, all without any."""
        return self._wait(partial(self._parameters, param_names))

    def on_set_parameters(
        self, _client: Client, parameters: list[Parameter], _request_id: str | None = None
    ) -> list[Parameter]:
        """Set parameters; return the values that they have now."""
        given = {each.name: each.get_value() for each in parameters}
        return self._wait(partial(self._set_parameters, given))

    def on_connection_graph_subscribe(self) -> None:
        """Publish the graph from now on."""
        self._graph_wanted = True
        self.show_graph()

    def on_connection_graph_unsubscribe(self) -> None:
        """Publish the graph no longer."""
        self._graph_wanted = False

    def _offer(self, vehicle: "ShownVehicle", service: Service[Any, Any]) -> Offered:
        schema = ServiceSchema(
            f"quadctl.{service.type_name}",
            request=_message_schema(service.request),
            response=_message_schema(service.response),
        )

        def on_call(request: ServiceRequest) -> bytes:
            job = partial(self._answer, vehicle, service, request.payload)
            try:
                return self._worker.call(request.client_id, request.call_id, job)
            except QuadctlError as problem:
                # The client gets the name and the text of any exception.
                raise Failure(_text(problem)) from problem

        return Offered(service_name(vehicle.name, service.name), schema=schema, handler=on_call)

    def _answer(self, vehicle: "ShownVehicle", service: Service[Any, Any], payload: bytes) -> bytes:
        self._check_control()
        try:
            request = msgspec.json.decode(payload or b"{}", type=service.request)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            hint = f"`quadctl type show {service.name}` prints its fields"
            raise Invalid(f"not a valid request of {service.name}: {error}", hint) from error
        return _json(vehicle.call(service, request))

    def _check_control(self) -> None:
        if not self._control:
            raise _READ_ONLY

    def _vehicle_of(self, topic: str) -> "ShownVehicle":
        """Return the vehicle that flies to goals on a topic; raise QuadctlError if none does."""
        self._check_control()
        vehicles = {f"/{name}{GOALS}": vehicle for name, vehicle in self._vehicles.items()}
        if len(vehicles) == 1:
            vehicles[GOALS] = next(iter(vehicles.values()))
        if topic not in vehicles:
            raise Invalid(f"nobody takes {topic}", f"publish to one of {', '.join(vehicles)}")
        return vehicles[topic]

    def _wait(self, job: Callable[[], list[Parameter]]) -> list[Parameter]:
        with contextlib.suppress(NotInTime, QuadctlError):
            return self._worker.submit(job).result(_PATIENCE)
        return []

    def _parameters(self, names: list[str]) -> list[Parameter]:
        found = {
            f"{vehicle.name}.{name}": value
            for vehicle in tuple(self._vehicles.values())
            for name, value in vehicle.parameters().items()
        }
        return [Parameter(name, value=found[name]) for name in names or found if name in found]

    def _set_parameters(self, given: dict[str, Any]) -> list[Parameter]:
        problem: QuadctlError | None = None
        for (vehicle, node), changes in by_node(given).items():
            try:
                self._check_control()
                if vehicle not in self._vehicles:
                    hint = f"one of {', '.join(self._vehicles)}"
                    raise Invalid(f"there is no vehicle {vehicle}", hint)
                self._vehicles[vehicle].set_parameters(node, changes)
            except QuadctlError as refusal:
                problem = refusal
        self.complain("parameters", problem)
        return self._parameters(list(given))

    def _publish_parameters(self, vehicle: "ShownVehicle") -> None:
        values = vehicle.parameters()
        self._server.publish_parameter_values(
            [Parameter(f"{vehicle.name}.{name}", value=each) for name, each in values.items()]
        )

    def _publish_graph(self) -> None:
        endpoints = []
        for vehicle in tuple(self._vehicles.values()):
            with contextlib.suppress(QuadctlError):
                endpoints += vehicle.endpoints()
        found = graph_of(endpoints)
        if found == self._graph:
            return
        self._graph, graph = found, ConnectionGraph()
        for table, put in (
            (found.published, graph.set_published_topic),
            (found.subscribed, graph.set_subscribed_topic),
            (found.served, graph.set_advertised_service),
        ):
            for name, nodes in table.items():
                put(name, nodes)
        self._server.publish_connection_graph(graph)


class ShownVehicle:
    """Vehicle as the server shows it; its messages are handled on Zenoh's one thread."""

    def __init__(self, server: FoxgloveServer, node: Node) -> None:
        self.name, self.drawing = node.vehicle, Drawing(node.vehicle)
        self.endpoints = node.endpoints
        self._server, self._node = server, node
        self._routes: dict[tuple[str, str], Route] = {}
        self._height = 0.0
        self._lock = threading.Lock()
        self._goal: bytes | None = None

    def listen(self) -> None:
        """Subscribe to all topics and calls of the vehicle."""
        keys = (f"{self.name}/**", f"{self.name}/@call/**")
        self._listener = listener = self._node.listen_raw(keys, self._show)
        for topic in TOPICS:
            if topic.latched:
                listener.request_latched(topic.key(self.name))

    def call(self, service: Service[Any, Any], request: Struct) -> Any:
        """Call a service of the vehicle; it blocks."""
        return self._node.client(service).call(request, _TIMEOUT)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the nodes that answer; it blocks."""
        values: dict[str, Any] = {}
        for node in _NODES:
            # A node that is down has no parameters now; the others' stay within reach.
            with contextlib.suppress(QuadctlError):
                values |= self.call(get_params(node), GetParamsRequest([])).values
        return values

    def set_parameters(self, node: str, changes: dict[str, Any]) -> None:
        """Set parameters of a node, all or none; raise QuadctlError if they are refused."""
        present = self.parameters()
        values = {name: to_ours(each, present.get(name)) for name, each in changes.items()}
        # The node itself refuses an unknown name, with the nearest one.
        owner = node if node in _NODES else _NODES[-1]
        reply = self.call(set_params(owner), SetParamsRequest(values))
        if not reply.success:
            raise Refused(reply.reason, "see `quadctl param describe`")

    def on_goal(self, topic: str, data: bytes) -> None:
        """Keep the newest goal only: a flood must not queue up."""
        with self._lock:
            waits, self._goal = self._goal is not None, data
        if not waits:
            try:
                self._server.submit(partial(self._fly, topic))
            except Refused:
                self._goal = None

    def _fly(self, topic: str) -> None:
        """Request the newest goal from safety; show its refusal to the clients."""
        with self._lock:
            data, self._goal = self._goal, None
        problem: QuadctlError | None = None
        try:
            reply = self.call(GOTO, goal_of(data or b"", self._height))
            if not reply.accepted:
                problem = Refused(f"safety refused the goal: {reply.reason}")
        except QuadctlError as error:
            problem = error
        self._server.complain(topic, problem)
        # Safety decides at this rate; a flood of goals leaves room for calls.
        time.sleep(1 / SETPOINT.hz)

    def _show(self, message: RawMessage) -> None:
        kind, channels = (message.key, message.encoding), self._server.channels
        route = self._routes.get(kind)
        if route is None:
            route = self._routes[kind] = Route(*kind)
        elif route.is_quiet and not channels.frames_wanted and not route.channel.has_sinks():
            return
        stored = route.form.stored(message.payload)
        if route.type is not stored.type:
            route.type, route.channel = stored.type, channels.of(message.key, stored.type)
        data = stored.data if stored.encoding == JSON else readable(message.payload, kind[1])
        channels.log(route.channel, data, message.at, latched=route.latched)
        if isinstance(stored.message, SafetyState):
            self._height = stored.message.goal.z
            self._server.show_graph()
        elif route.sets_parameters:
            self._server.show_parameters(self)
        if derived := self.drawing.derive(message.key, stored.message, message.at):
            channels.draw(derived, message.at)


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


def _text(problem: QuadctlError) -> str:
    return f"{problem.message}: {problem.hint}" if problem.hint else problem.message


_json = msgspec.json.encode


def _message_schema(type_: type[Struct]) -> MessageSchema:
    return MessageSchema(encoding=JSON, schema=schema_of(f"quadctl.{type_.__name__}", type_))


if __name__ == "__main__":
    main()
