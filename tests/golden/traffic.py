"""Recorded client and recorded nodes: only Zenoh and MessagePack, nothing of the product."""

import json
import threading
from types import TracebackType
from typing import Any, Self

import zenoh

from tests.golden.shapes import tokens
from tests.support.bare import Bare, pack, unpack
from tests.support.lab import PATIENT, Lab
from tests.support.running import eventually

TOPICS = (
    "uav/pose",
    "uav/sensors/pressure",
    "uav/safety/state",
    "uav/safety/zones",
    "uav/input/position",
    "uav/info",
)
_PERIOD = 0.02
"""Seconds between two rounds of the recorded publishers."""

Sent = dict[str, Any]
"""Key, encoding and payload (hex) of a message."""


def ask(bare: Bare, request: dict[str, Any]) -> list[dict[str, Any]]:
    """Send a recorded request; return all replies, each with encoding, payload and shape."""
    attachment = bytes.fromhex(request["attachment"])
    replies = bare.session.get(
        request["key"],
        payload=bytes.fromhex(request["payload"]),
        encoding=request["encoding"],
        attachment=attachment or None,
        timeout=5.0,
    )
    return [_replied(reply) for reply in replies]


def _replied(reply: zenoh.Reply) -> dict[str, Any]:
    if reply.ok is not None:
        payload = reply.ok.payload.to_bytes()
        return {
            "ok": True,
            "encoding": str(reply.ok.encoding),
            "payload": payload.hex(),
            "shape": shape(unpack(payload)),
        }
    assert reply.err is not None
    payload = reply.err.payload.to_bytes()
    error = json.loads(payload)
    return {
        "ok": False,
        "encoding": str(reply.err.encoding),
        "payload": payload.hex(),
        "shape": shape(error) | {"code": error["code"]},
    }


def shape(value: Any) -> Any:
    """Return a decoded value with its wording and numbers replaced by their types."""
    if isinstance(value, dict):
        return {name: shape(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [shape(inner) for inner in value]
    return value if isinstance(value, bool) or value == "" else type(value).__name__


def conversation(lab: Lab, requests: list[dict[str, Any]]) -> dict[str, Any]:
    """Start a system, send it the requests one by one, and record what it publishes."""
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    with lab.bare() as bare:
        received = _Received(bare)
        exchanges = []
        for request in requests:
            exchanges.append(request | {"replies": ask(bare, request)})
            received.after(request["name"])
        return {
            "exchanges": exchanges,
            "topics": received.newest,
            "flight": received.flight,
            "tokens": tokens(bare),
        }


class _Received:
    """Newest message of each topic, and the states of the flight that `goto` begins."""

    def __init__(self, bare: Bare) -> None:
        self.newest: dict[str, Sent] = {}
        self.flight: list[Sent] = []
        self._changed = threading.Condition()
        self._messages: list[Sent] = []
        self._declared = [bare.session.declare_subscriber(key, self._take) for key in TOPICS]
        for key in ("uav/info", "uav/safety/zones"):
            for reply in bare.session.get(key, timeout=3.0):
                assert reply.ok is not None
                self._take(reply.ok)

    def _take(self, sample: zenoh.Sample) -> None:
        sent = {
            "key": str(sample.key_expr),
            "encoding": str(sample.encoding),
            "payload": sample.payload.to_bytes().hex(),
        }
        with self._changed:
            self._messages.append(sent)
            self._changed.notify_all()

    def after(self, name: str) -> None:
        """Wait for the messages that the nodes publish because of the request `name`."""
        if name == "calibrate":
            self._until("uav/sensors/pressure", lambda said: said["baseline"] > 0)
        elif name == "goto":
            self._messages_of_the_flight()
            for key in TOPICS:
                self._until(key, lambda _: True)

    def _messages_of_the_flight(self) -> None:
        goal = {"x": 0.5, "y": 0.0, "z": 1.0}

        def arrived(said: Any) -> bool:
            return bool(said["goal"] == goal and said["state"] == "HOVERING")

        self._until("uav/safety/state", arrived)
        states = [sent for sent in self._messages if sent["key"] == "uav/safety/state"]
        self.flight = [
            sent for sent in states if unpack(bytes.fromhex(sent["payload"]))["goal"] == goal
        ]

    def _until(self, key: str, condition: Any) -> None:
        def found() -> bool:
            for sent in self._messages:
                if sent["key"] == key and condition(unpack(bytes.fromhex(sent["payload"]))):
                    self.newest.setdefault(key, sent)
                    return True
            return False

        with self._changed:
            assert self._changed.wait_for(found, 10.0), f"{key}: {self._messages[-3:]}"


class Nodes:
    """Dynamics, pressure and safety, played from the recording on the hub of a lab."""

    def __init__(self, bare: Bare, recorded: dict[str, Any]) -> None:
        self.asked: list[str] = []
        """Names of the recorded requests that were received."""
        self.unrecorded: list[str] = []
        """Received requests that differ from the recording."""
        self._bare, self._topics = bare, recorded["topics"]
        self._flight = recorded["flight"]
        self._state: Sent = self._topics["uav/safety/state"]
        self._coming: list[Sent] = []
        self._exchanges = recorded["exchanges"]
        self._tokens = [token for token in recorded["tokens"] if "/@node/hub" not in token]
        self._over = threading.Event()
        self._player = threading.Thread(target=self._play, daemon=True)
        self._declared: list[Any] = []

    def __enter__(self) -> Self:
        session = self._bare.session
        keys = {exchange["key"] for exchange in self._exchanges}
        self._declared = [
            *(session.declare_queryable(key, self._serve, complete=True) for key in sorted(keys)),
            *(
                session.declare_queryable(key, self._latched, complete=True)
                for key in ("uav/safety/state", "uav/safety/zones", "uav/info")
            ),
            *(session.liveliness().declare_token(token) for token in self._tokens),
        ]
        self._player.start()
        eventually(lambda: set(self._tokens) <= set(tokens(self._bare)))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        self._player.join()

    def _serve(self, query: zenoh.Query) -> None:
        with query:
            key, asked = str(query.key_expr), _asked(query)
            for exchange in self._exchanges:
                if (exchange["key"], exchange["encoding"], exchange["payload"]) == (key, *asked):
                    break
            else:
                self.unrecorded.append(f"{key}: {asked}")
                query.reply_err(pack("not recorded"))
                return
            self._check(query)
            self.asked.append(exchange["name"])
            (reply,) = exchange["replies"]
            payload = bytes.fromhex(reply["payload"])
            if not reply["ok"]:
                query.reply_err(payload, encoding=reply["encoding"])
                return
            query.reply(key, payload, encoding=reply["encoding"])
            if exchange["name"] == "goto":
                self._coming = [*self._flight]

    def _check(self, query: zenoh.Query) -> None:
        sent = query.attachment
        ticket = unpack(sent.to_bytes()) if sent is not None else {}
        if {name: type(value).__name__ for name, value in ticket.items()} != {
            "id": "str", "deadline": "float", "at": "NoneType", "boot": "str",
        }:  # fmt: skip
            self.unrecorded.append(f"{query.key_expr}: the attachment {ticket}")

    def _latched(self, query: zenoh.Query) -> None:
        with query:
            key = str(query.key_expr)
            sent = self._state if key == "uav/safety/state" else self._topics[key]
            query.reply(key, bytes.fromhex(sent["payload"]), encoding=sent["encoding"])

    def _play(self) -> None:
        while not self._over.wait(_PERIOD):
            if self._coming:
                self._state = self._coming.pop(0)
            for sent in (self._state, *self._topics.values()):
                if sent["key"] != "uav/safety/state" or sent is self._state:
                    payload = bytes.fromhex(sent["payload"])
                    self._bare.session.put(sent["key"], payload, encoding=sent["encoding"])


def _asked(query: zenoh.Query) -> tuple[str, str]:
    payload = query.payload
    return str(query.encoding), payload.to_bytes().hex() if payload is not None else ""
