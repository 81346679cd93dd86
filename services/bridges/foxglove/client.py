"""Client of the server: its subscriptions, its backlog, and its requests in their order."""

import asyncio
import secrets
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed

from quadctl.services.bridges.base import Log, RequestQueue, Taken
from quadctl.services.bridges.foxglove.protocol import (
    JSON,
    ClientAdvertise,
    ClientChannel,
    ClientMessage,
    ClientUnadvertise,
    FoxgloveParameter,
    GetParameters,
    Graph,
    ServiceCall,
    SetParameters,
    Subscribe,
    SubscribeConnectionGraph,
    SubscribeParameterUpdates,
    Unsubscribe,
    UnsubscribeConnectionGraph,
    UnsubscribeParameterUpdates,
    document,
    message_frame,
    request_of,
    response_frame,
)
from quadctl.services.bridges.foxglove.vehicles import Vehicles
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused

_BACKLOG = 4 << 20
"""Bytes of messages that may wait for a slow client; beyond, it loses the oldest."""
_MOST_ANSWERS = 16 << 20
"""Bytes of documents that may wait for a client; one that reads none of so many is disconnected."""
_MOST_UNSENT = 8 << 20
"""Bytes that the socket of a client may hold; answers to its pings wait there, too."""
_PATIENCE = 60
"""Seconds for which a client may read nothing at all."""
_TURN = 32
"""Requests of a client that are taken in a row before other clients have their turn."""
_MOST_TOPICS, _LONGEST_NAME = 1000, 256
"""Topics that a client may publish on, or parameters that it may watch, and their longest name."""
_LONGEST_TEXT = 1000
"""Characters of a problem that a client is shown: it may quote the client's request."""
_EVERY = ""
"""Name for all parameters."""
_ERROR = 2
"""Level of a status that reports a problem."""


Messages = Iterable[tuple[bytes, int]]
"""Messages, and the Unix times (ns) at which they came."""


class Channel:
    """Channel of the server. A late subscriber gets its `latest` messages, by default the `last`."""

    def __init__(
        self, advertised: dict[str, Any], latest: Callable[[], Messages] | None = None
    ) -> None:
        self.advertised = advertised
        self.last: tuple[bytes, int] | None = None
        self.latest = latest or (lambda: [self.last] if self.last else [])
        self.subscribers: dict[FoxgloveClient, int] = {}
        """Subscription of each client that has one."""


class Host:
    """Part of the server that its clients use. Without a token nobody may act."""

    def __init__(self, vehicles: Vehicles, log: Log, token: str) -> None:
        self.vehicles, self.log, self._token = vehicles, log, token
        self.channels: dict[int, Channel] = {}
        self.services: dict[int, dict[str, Any]] = {}
        self.loop: asyncio.AbstractEventLoop
        self._stale, self._asked = set[str](), asyncio.Event()

    def refresh(self, what: str) -> None:
        """Read the `graph` or the `parameters` anew, if a client has subscribed; from any thread."""
        self.loop.call_soon_threadsafe(self._mark_stale, what)

    def why_watching(self, token: str) -> Refused | None:
        """Return why a client may only watch, None with the right token; any other one takes as long."""
        hint = "start the bridge by `quadctl bridge foxglove --control`"
        if self._token:
            if secrets.compare_digest(self._token.encode(), token.encode()):
                return None
            hint = "open the address with the token that `quadctl bridge foxglove` prints"
        return Refused("this client may only watch", hint)

    def tried(self, do: Callable[..., Any], *of: Any) -> Any:
        """Return the result of a method of the vehicles, which blocks; a fault in it becomes a Refused."""
        try:
            return do(*of)
        except QuadctlError:
            raise
        except Exception as fault:
            self.log.exception("a request failed")
            raise Refused(f"the bridge has a fault: {fault}", "its log has more") from fault

    def _mark_stale(self, what: str) -> None:
        self._stale.add(what)
        self._asked.set()


class FoxgloveClient:
    """Client of the server. Its methods are called on the server's thread, requests on their own."""

    def __init__(self, server: Host, connection: ServerConnection) -> None:
        self._server, self._connection = server, connection
        path = connection.request.path if connection.request else ""
        self._token = token_of(path)
        self.controls = server.why_watching(self._token) is None
        self.subscriptions: dict[int, Channel] = {}
        self.watched: set[str] = set()
        """Names of the parameters subscribed to, or _EVERY."""
        self._values: dict[str, FoxgloveParameter] = {}
        self.graph: Graph | None = None
        """Graph as it was shown to the client; none without a subscription."""
        self._topics: dict[int, str] = {}
        self._problems: set[str] = set()
        self._answers: deque[str | bytes] = deque()
        self._messages: deque[bytes] = deque()
        self._answer_bytes = self._bytes = self._written = 0
        self._ready = asyncio.Event()
        self._requests = RequestQueue(
            lambda fault: server.log.error("a request failed", exc_info=fault)
        )

    async def serve(self) -> None:
        """Take requests until the client leaves."""
        tasks = [asyncio.create_task(each) for each in (self._write(), self._watch())]
        if self._token and not self.controls:
            self.complain("token", Refused("the token in this address is not of this bridge"))
        try:
            count = 0
            async for data in self._connection:
                self._take(data)
                if count := (count + 1) % _TURN:
                    continue
                # The next requests may be here already, and nobody else is served meanwhile.
                await asyncio.sleep(0)
        except ConnectionClosed:
            pass
        finally:
            self._requests.end()
            for task in tasks:
                task.cancel()

    def send(self, frame: bytes) -> None:
        """Send a message; a client that is too slow loses its oldest ones."""
        if not (self._answers or self._messages or self._unsent):
            # Nothing waits: to wake the writer would cost as much as the whole message.
            broadcast((self._connection,), frame)
            self._written += 1
            return
        self._messages.append(frame)
        self._bytes += len(frame)
        while self._bytes > _BACKLOG and len(self._messages) > 1:
            self._bytes -= len(self._messages.popleft())
        self._ready.set()

    def tell(self, op: str, **fields: Any) -> None:
        """Send a document, before all messages that wait."""
        self._answer(document(op, **fields))

    def complain(self, what: str, problem: QuadctlError | None) -> None:
        """Show a problem until it is over, which None means."""
        if problem is not None:
            self._problems.add(what)
            self.tell("status", level=_ERROR, message=_text_of(problem), id=what)
        elif what in self._problems:
            self._problems.remove(what)
            self.tell("removeStatus", statusIds=[what])

    def unsubscribe(self, numbers: Iterable[int]) -> None:
        """End subscriptions."""
        for number in numbers:
            if channel := self.subscriptions.pop(number, None):
                del channel.subscribers[self]

    def show_graph(self, graph: Graph) -> None:
        """Send a graph that is new to the client, if it has subscribed to it."""
        if self.graph is not None and graph != self.graph:
            self.tell("connectionGraphUpdate", **graph.update(self.graph))
            self.graph = graph

    def show_parameters(self, values: Iterable[FoxgloveParameter]) -> None:
        """Send the parameters that the client has subscribed to, and that have changed."""
        new = [
            each
            for each in values
            if (_EVERY in self.watched or each.name in self.watched)
            and self._values.get(each.name) != each
        ]
        if new:
            self._values |= {each.name: each for each in new}
            self.tell("parameterValues", parameters=new)

    def _answer(self, frame: str | bytes) -> None:
        self._answer_bytes += len(frame)
        if self._answer_bytes > _MOST_ANSWERS:
            self._connection.transport.abort()
            return
        self._answers.append(frame)
        self._ready.set()

    async def _write(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                await self._ready.wait()
                self._ready.clear()
                while self._answers or self._messages:
                    self._written += 1
                    if self._answers:
                        answer = self._answers.popleft()
                        self._answer_bytes -= len(answer)
                        await self._connection.send(answer)
                        continue
                    frame = self._messages.popleft()
                    self._bytes -= len(frame)
                    await self._connection.send(frame)

    async def _watch(self) -> None:
        """Disconnect a client that does not read."""
        written, idle = -1, 0
        while True:
            await asyncio.sleep(1)
            waits = self._answers or self._messages
            idle = idle + 1 if waits and written == self._written else 0
            written = self._written
            if idle > _PATIENCE or self._unsent > _MOST_UNSENT:
                self._connection.transport.abort()

    @property
    def _unsent(self) -> int:
        """Return the bytes that the socket has not taken yet."""
        return self._connection.transport.get_write_buffer_size()

    def _take(self, data: str | bytes) -> None:
        try:
            request = request_of(data)
        except Invalid as problem:
            self.complain("request", problem)
            return
        match request:
            case ClientMessage(number, payload):
                self._publish(self._topics.get(number, ""), payload)
            case ServiceCall():
                taken = self._requests.order(partial(self._call, request))
                self._check_room(taken, partial(self._fail, request))
            case ClientAdvertise(channels):
                for channel in channels:
                    self._advertise(channel)
            case ClientUnadvertise(numbers):
                for number in numbers:
                    self._forget(number)
            case GetParameters():
                read = partial(self._get_parameters, request.parameter_names, request.id)
                self._check_room(self._requests.read(read))
            case SetParameters():
                self._check_room(self._requests.order(partial(self._set_parameters, request)))
            case _:
                self._change_subscriptions(request)

    def _change_subscriptions(self, request: Any) -> None:
        match request:
            case Subscribe(subscriptions):
                for each in subscriptions:
                    self._subscribe(each.id, each.channel_id)
            case Unsubscribe(numbers):
                self.unsubscribe(numbers)
            case SubscribeParameterUpdates(names):
                self.watched |= {each[:_LONGEST_NAME] for each in names} or {_EVERY}
                if len(self.watched) > _MOST_TOPICS:
                    self.watched = {_EVERY}
                self._server.refresh("parameters")
            case UnsubscribeParameterUpdates(names):
                self.watched -= set(names) or set(self.watched)
                self._values = {}
            case SubscribeConnectionGraph():
                self.graph = Graph({}, {}, {})
                self._server.refresh("graph")
            case UnsubscribeConnectionGraph():
                self.graph = None

    def _subscribe(self, number: int, to: int) -> None:
        channel = self._server.channels.get(to)
        if channel is None:
            self.complain("subscription", Invalid(f"there is no channel {to}"))
        elif number in self.subscriptions or self in channel.subscribers:
            self.complain("subscription", Invalid(f"subscription {number} to {to} is one too many"))
        else:
            self.subscriptions[number] = channel
            channel.subscribers[self] = number
            # After that: a message that comes meanwhile must not be missed.
            for data, at in channel.latest():
                self.send(message_frame(number, at, data))

    def _check_room(
        self, taken: Taken, fail: Callable[[QuadctlError], object] | None = None
    ) -> None:
        """Call `fail`, or show the problem, if too many requests wait."""
        if taken == "full":
            problem = Refused("too many requests wait", "send the next ones after the answers")
            (fail or partial(self.complain, "request"))(problem)

    def _later(self, do: Callable[..., object], *of: Any) -> None:
        """Do something on the server's thread, from another one."""
        self._server.loop.call_soon_threadsafe(do, *of)

    def _check_control(self) -> None:
        if why := self._server.why_watching(self._token):
            raise why

    def _call(self, call: ServiceCall) -> None:
        try:
            self._check_control()
            service = self._server.services.get(call.service)
            if service is None:
                raise Invalid(f"there is no service {call.service}")
            if call.encoding != JSON:
                raise Invalid(f"the request is {call.encoding}", "send JSON")
            reply = self._server.tried(self._server.vehicles.call, service["name"], call.payload)
            self._later(self._answer, response_frame(call, reply))
            self._later(self.complain, "call", None)
        except QuadctlError as problem:
            self._later(self._fail, call, problem)

    def _fail(self, call: ServiceCall, problem: QuadctlError) -> None:
        text = _text_of(problem)
        self.tell("serviceCallFailure", serviceId=call.service, callId=call.number, message=text)
        # Lichtblick shows no failure of a call.
        self.complain("call", problem)

    def _problem(self, do: Callable[..., Any], *of: Any) -> QuadctlError | None:
        """Let the client act; return why it failed, if it did."""
        try:
            self._check_control()
            self._server.tried(do, *of)
        except QuadctlError as problem:
            return problem
        return None

    def _advertise(self, channel: ClientChannel) -> None:
        self._forget(channel.id)
        if len(self._topics) >= _MOST_TOPICS or len(channel.topic) > _LONGEST_NAME:
            most = f"{_MOST_TOPICS} topics of {_LONGEST_NAME} characters"
            self.complain("topics", Refused(f"at most {most} are taken"))
            return
        self._topics[channel.id] = channel.topic
        goals = self._server.vehicles.flown_by
        self.complain(channel.topic, self._problem(goals, channel.topic))

    def _publish(self, topic: str, data: bytes) -> None:
        if self._problem(self._server.vehicles.flown_by, topic):
            return  # shown since the topic was advertised
        fly = partial(self._fly, topic, data)
        taken = self._requests.order(fly, newest=topic)
        self._check_room(taken, partial(self.complain, topic))

    def _forget(self, number: int) -> None:
        """Forget a topic of the client, and what was wrong with it."""
        if topic := self._topics.pop(number, ""):
            self.complain(topic, None)

    def _fly(self, topic: str, data: bytes) -> None:
        problem = self._problem(self._server.vehicles.fly, topic, data)
        self._later(self.complain, topic, problem)

    def _get_parameters(self, names: list[str], request: str) -> None:
        with suppress(QuadctlError):
            values = self._server.tried(self._server.vehicles.parameters, names)
            self._later(partial(self.tell, "parameterValues", parameters=values, id=request))

    def _set_parameters(self, request: SetParameters) -> None:
        problem = self._problem(self._server.vehicles.set_parameters, request.parameters)
        self._later(self.complain, "parameters", problem)
        # With the present values, a page shows what has become of its own.
        self._get_parameters([each.name for each in request.parameters], request.id)


def _text_of(problem: QuadctlError) -> str:
    """Return a problem and its hint in one line, cut to what a client is shown."""
    text = f"{problem.message}: {problem.hint}" if problem.hint else problem.message
    return text[:_LONGEST_TEXT]


def token_of(path: str) -> str:
    """Return the token in the path of an address, else an empty text."""
    return parse_qs(urlsplit(path).query).get("token", [""])[0]
