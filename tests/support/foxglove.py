"""Client of the protocol of Foxglove, written from its specification, over `websockets`."""

import json
import os
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple, Self

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.support import bridges
from tests.support.running import DEADLINE, eventually

SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
OLD_SUBPROTOCOL = Subprotocol("foxglove.websocket.v1")
TOKEN = "the-token"
WITH_TOKEN = {**os.environ, "QUADCTL_FOXGLOVE_TOKEN": TOKEN}
_MESSAGE, _REQUEST, _RESPONSE = 1, 2, 3


class Message(NamedTuple):
    topic: str
    at: int
    data: bytes
    came: float
    """Arrival here, by `time.perf_counter`."""

    @property
    def json(self) -> Any:
        return json.loads(self.data)


class ServiceFailed(Exception):
    """Failure of a call, with the text that Foxglove shows."""


class FoxgloveClient:
    """Client of a bridge; a thread collects what comes, `wait` returns it."""

    def __init__(
        self,
        port: int,
        *topics: str,
        everything: bool = False,
        reading: bool = True,
        token: str = TOKEN,
        subprotocol: Subprotocol = SUBPROTOCOL,
    ) -> None:
        self._open = ExitStack()
        address = f"ws://127.0.0.1:{port}/"
        self._socket = self._open.enter_context(
            connect(
                f"{address}?token={token}" if token else address,
                subprotocols=[subprotocol],
                max_size=None,
                compression=None,
            )
        )
        assert self._socket.subprotocol == subprotocol
        self._came = threading.Condition()
        self._topics, self._everything = set(topics), everything
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.documents: list[dict[str, Any]] = []
        self.messages: list[Message] = []
        self.answers: list[tuple[int, Any]] = []
        self._subscriptions: dict[int, str] = {}
        self._calls = 0
        self.closed = False
        if reading:
            self.read()

    def read(self) -> None:
        """Read what comes from now on, and wait for the services."""
        threading.Thread(target=self._read, daemon=True).start()
        self.wait(lambda: "uav/goto" in self.services or "uav0/goto" in self.services)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def wait(self, condition: Callable[[], Any], timeout: float = DEADLINE) -> Any:
        """Return the first true result of a condition, checked after each message."""
        with self._came:
            found = self._came.wait_for(condition, timeout)
            assert found, [str(document)[:200] for document in self.documents[-5:]]
            return found

    def message(
        self,
        topic: str,
        condition: Callable[[Any], bool] = lambda _: True,
        timeout: float = DEADLINE,
        *,
        past: bool = False,
    ) -> Any:
        """Return the next message of a topic, or of the `past` too, as plain data, that fulfils a condition."""
        seen = 0 if past else len(self.messages)

        def found() -> list[Any]:
            nonlocal seen
            new, seen = self.messages[seen:], len(self.messages)
            plain = (each.json for each in new if each.topic == topic)
            return [each for each in plain if condition(each)]

        return self.wait(found, timeout)[0]

    def document(self, op: str, condition: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the first document of a kind, also of the past, that fulfils a condition."""
        return self.wait(
            lambda: [each for each in self.documents if each["op"] == op and condition(each)]
        )[0]

    def send(self, op: str, **fields: Any) -> None:
        self._socket.send(json.dumps({"op": op, **fields}))

    def send_bytes(self, data: bytes) -> None:
        self._socket.send(data)

    def subscribe(self, *topics: str) -> None:
        for topic in topics:
            number = self.channels[topic]["id"]
            self._subscriptions[number] = topic
            self.send("subscribe", subscriptions=[{"id": number, "channelId": number}])

    def subscribe_unread(self, *channels: dict[str, Any]) -> None:
        """Subscribe to channels that another client has been told of."""
        for each in channels:
            self._subscriptions[each["id"]] = each["topic"]
            self.send("subscribe", subscriptions=[{"id": each["id"], "channelId": each["id"]}])

    def request(self, service: str, payload: bytes) -> int:
        """Send a call without waiting for its answer; return its id."""
        self._calls += 1
        self._socket.send(request(self.services[service]["id"], self._calls, payload))
        return self._calls

    def call(self, service: str, **request: Any) -> Any:
        """Call a service; return its response or raise ServiceFailed."""
        return self.answer(self.request(service, json.dumps(request).encode()))

    def answer(self, number: int) -> Any:
        """Wait for the answer of a call."""
        (answer,) = self.wait(lambda: [each for call, each in self.answers if call == number])
        if isinstance(answer, ServiceFailed):
            raise answer
        return answer

    def publish(self, topic: str, channel: int = 1) -> Callable[[bytes], None]:
        """Advertise a topic; return a function that publishes on it."""
        advert = {"id": channel, "topic": topic, "encoding": "json", "schemaName": ""}
        self.send("advertise", channels=[advert])
        return lambda data: self._socket.send(struct.pack("<BI", _MESSAGE, channel) + data)

    def parameters(self, *names: str) -> dict[str, Any]:
        """Read parameters; return the whole entries by name."""
        return self._asked("getParameters", parameterNames=list(names))

    def set_parameters(self, **values: Any) -> dict[str, Any]:
        """Set parameters, given as keywords of their dotted names; return the present entries."""
        given = [{"name": name, "value": value} for name, value in values.items()]
        return self._asked("setParameters", parameters=given)

    def _asked(self, op: str, **fields: Any) -> dict[str, Any]:
        id_ = f"{op} {len(self.documents)}"
        self.send(op, id=id_, **fields)
        found = self.document("parameterValues", lambda each: each.get("id") == id_)
        return {each["name"]: each for each in found["parameters"]}

    def _read(self) -> None:
        try:
            for data in self._socket:
                with self._came:
                    self._take(data)
                    self._came.notify_all()
        except ConnectionClosed:
            pass
        self.closed = True

    def _take(self, data: str | bytes) -> None:
        if isinstance(data, str):
            document = json.loads(data)
            self.documents.append(document)
            self._take_document(document)
        elif data[0] == _MESSAGE:
            number, at = struct.unpack_from("<IQ", data, 1)
            topic, came = self._subscriptions[number], time.perf_counter()
            self.messages.append(Message(topic, at, data[13:], came))
        elif answer := response(data):
            self.answers.append(answer)

    def _take_document(self, document: dict[str, Any]) -> None:
        match document["op"]:
            case "advertise":
                for each in document["channels"]:
                    self.channels[each["topic"]] = each
                    if self._everything or each["topic"] in self._topics:
                        self.subscribe(each["topic"])
            case "advertiseServices":
                self.services |= {each["name"]: each for each in document["services"]}
            case "serviceCallFailure":
                self.answers.append((document["callId"], ServiceFailed(document["message"])))


def request(service: int, call: int, payload: bytes) -> bytes:
    """Return the frame of a call to the service with this id, in JSON."""
    return struct.pack("<BIII", _REQUEST, service, call, 4) + b"json" + payload


def response(data: bytes) -> tuple[int, Any] | None:
    """Return the id and the answer of a call, None for a frame of another kind."""
    if data[0] != _RESPONSE:
        return None
    _, call, length = struct.unpack_from("<III", data, 1)
    return call, json.loads(data[13 + length :])


@contextmanager
def bridge(realm: str, port: int, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    """Bridge a run on a port, from when it serves; see bridges.bridge."""
    words = ("--port", str(port), *more)
    with bridges.bridge(realm, "foxglove", *words, environment=WITH_TOKEN) as process:
        eventually(lambda: serves(port))
        yield process


def serves(port: int) -> bool:
    """Return whether a bridge serves a port."""
    try:
        with connect(f"ws://127.0.0.1:{port}", subprotocols=[SUBPROTOCOL]):
            return True
    except OSError:
        return False
