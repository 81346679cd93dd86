"""Snapshot of the whole bus for `quadctl doctor`: nodes, rates, answers.

It changes nothing. A service other than `get_params` is called with an empty request whose
deadline has passed: a server that replies `expired` has a running loop. Only a third-party server
that checks neither deadline nor payload would execute the call.
"""

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import msgspec
import zenoh
from msgspec import Struct, field

from quadctl.schemas import keyexpr
from quadctl.schemas.services import Call, GetParamsRequest, GetParamsResponse
from quadctl.schemas.topics import SERVICES, get_params, set_params
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.session import Address, open_client
from quadctl.services.runtime.bus.zenoh_events import ALL_SERVERS
from quadctl.services.runtime.errors import Invalid, TimedOut
from quadctl.services.runtime.security.endpoints import is_secure

_KEPT = 32


class TopicStats:
    """Statistics of a key's messages; `now` is monotonic, `age` by the sender's stamp, both s."""

    def __init__(self) -> None:
        self.count = 0
        self.age = 0.0
        self.newest: deque[bytes] = deque(maxlen=_KEPT)
        """Last payloads, the newest last."""
        self._first = self._last = 0.0
        self._payloads = (b"", b"")
        self._sources: dict[str, tuple[float, float]] = {}

    def take(self, now: float, payload: bytes, source: str, age: float) -> None:
        """Count a message; `source` is the session that stamped it, empty if none has."""
        if not self.count:
            self._first, self._payloads = now, (payload, payload)
        self.count, self._last = self.count + 1, now
        self._payloads = (self._payloads[0], payload)
        self.newest.append(payload)
        if source:
            began, _ = self._sources.get(source, (now, now))
            self._sources[source] = (began, now)
            self.age = max(self.age, age, key=abs)

    @property
    def hz(self) -> float:
        """Return the messages per second, 0 for fewer than two."""
        return (self.count - 1) / self._span if self.count > 1 and self._span else 0.0

    @property
    def pace(self) -> float:
        """Return the simulated seconds per second, by the messages' `stamp`; 0 without any."""
        first, last = map(_stamp, self._payloads)
        if first is None or last is None or not self._span:
            return 0.0
        return max(last - first, 0.0) / self._span

    @property
    def publishers(self) -> int:
        """Return the most publishers at the same time; a replacement of one does not count."""
        spans = self._sources.values()
        return max(
            (sum(a <= end and begin <= b for a, b in spans) for begin, end in spans), default=0
        )

    @property
    def _span(self) -> float:
        return self._last - self._first


def _stamp(payload: bytes) -> float | None:
    try:
        message: Any = msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    stamp = message.get("stamp") if isinstance(message, dict) else None
    return stamp if isinstance(stamp, float) else None


class Answer(NamedTuple):
    """Answer of one server: `code` is empty for a reply, else the error's, or `timeout`."""

    server: str
    code: str
    seconds: float
    values: dict[str, Any]


class Survey(Struct):
    """Result of a survey: times in s, topics and services by their full keys."""

    connected: float = 0.0
    listened: float = 0.0
    nodes: list[str] = field(default_factory=list)
    offers: list[keyexpr.EndpointInfo] = field(default_factory=list)
    topics: dict[str, TopicStats] = field(default_factory=dict)
    answers: dict[str, list[Answer]] = field(default_factory=dict)


def answer_of(reply: zenoh.Reply, seconds: float) -> Answer:
    """Return the content of a reply to a call that came after so many seconds."""
    server = str(reply.replier_id.zid) if reply.replier_id else ""
    code, values = "", {}
    if (ok := reply.ok) is not None:
        if codec.type_name(encoding := str(ok.encoding)) == GetParamsResponse.__name__:
            try:
                values = codec.decode(GetParamsResponse, ok.payload.to_bytes(), encoding).values
            except Invalid as error:
                code = error.code
    elif reply.err is None or str(reply.err.encoding) != codec.ERROR_ENCODING:
        code = TimedOut.code
    else:
        code = codec.decode_error(reply.err.payload.to_bytes()).code
    return Answer(server, code, seconds, values)


SHORTEST, LONGEST = 1.0, 2.2
"""Seconds to listen: enough for ten messages at 10 Hz, and for two at 1 Hz."""
_GET_PARAMS = get_params("").type_name
_CALLED = {_GET_PARAMS, set_params("").type_name, *(service.type_name for service in SERVICES)}
_LOOK_UP = 0.02
"""Longest time (s) between two checks of the clock."""


def survey(address: Address, vehicle: str, timeout: float) -> Survey:
    """Survey the bus for at most `timeout` s.

    Raises Unreachable if there is no hub, TimedOut if it does not answer in half of that time.
    """
    began = time.monotonic()
    with open_client(address, timeout=timeout / 2) as session:
        surveyor = _Surveyor(session, vehicle, began + timeout)
        surveyor.found.connected = time.monotonic() - began
        surveyor.find_nodes(began + timeout / 2)
        surveyor.listen()
        surveyor.call(address.endpoint)
        surveyor.wait()
        return surveyor.found


def _allowed(endpoint: str, key: str) -> bool:
    from quadctl.services.runtime.security import permissions

    return permissions.allows(endpoint, "call", key)


class _Surveyor:
    """Survey in progress: Zenoh's threads only fill the queue, our thread alone changes `found`."""

    def __init__(self, session: zenoh.Session, vehicle: str, deadline: float) -> None:
        self.found = Survey()
        self._session, self._vehicle, self._deadline = session, vehicle, deadline
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._pending, self._timed_out = 0, False
        self._subscribers: list[zenoh.Subscriber[None]] = []

    def find_nodes(self, deadline: float) -> None:
        """Find the nodes and their endpoints; raise TimedOut if the hub is silent."""
        timeout = max(deadline - time.monotonic(), 0.001)
        for pattern in ("*", "*/@pub/**", "*/@srv/**", "*/@sub/**"):
            self._pending += 1
            self._session.liveliness().get(
                f"{self._vehicle}/@node/{pattern}",
                zenoh.handlers.Callback(self._posted(self._on_token), self._on_end, indirect=False),
                timeout=timeout,
            )
        self._serve(deadline, lambda: not self._pending)
        if self._timed_out or self._pending:
            raise TimedOut("the hub accepts connections but does not answer")
        self.found.nodes.sort()
        self.found.offers.sort(key=lambda offer: (offer.key, offer.node))

    def listen(self) -> None:
        """Subscribe to every topic."""
        for key in {offer.key for offer in self.found.offers if offer.kind == "@pub"}:
            self.found.topics[key] = TopicStats()
            handler = zenoh.handlers.Callback(self._samples(key), indirect=False)
            # A foreign node may declare an invalid key, on which no message can come.
            with contextlib.suppress(zenoh.ZError):
                self._subscribers.append(self._session.declare_subscriber(key, handler))

    def call(self, endpoint: str) -> None:
        """Call every known service that we may call, all its servers at once."""
        left = max(self._deadline - time.monotonic(), 0.001)
        offers = [offer for offer in self.found.offers if offer.kind == "@srv"]
        for key, type_ in sorted({(o.key, o.type) for o in offers if o.type in _CALLED}):
            if is_secure(endpoint) and not _allowed(endpoint, key):
                continue
            is_get = type_ == _GET_PARAMS
            ticket = Call(os.urandom(8).hex(), time.time() + left if is_get else 0.0)
            self.found.answers[key] = []
            with contextlib.suppress(zenoh.ZError):
                self._session.get(
                    key,
                    zenoh.handlers.Callback(self._replies(key), self._on_end, indirect=False),
                    payload=codec.encode(GetParamsRequest([])) if is_get else b"",
                    attachment=codec.encode(ticket),
                    timeout=left,
                    **ALL_SERVERS,
                )
                self._pending += 1

    def wait(self) -> None:
        """Collect messages and replies until there are enough, or the time is up."""
        began = time.monotonic()
        paced = {offer.key for offer in self.found.offers if offer.kind == "@pub" and offer.hz}

        def enough() -> bool:
            elapsed = time.monotonic() - began
            complete = all(self.found.topics[key].count > 1 for key in paced)
            return not self._pending and elapsed > (SHORTEST if complete else LONGEST)

        self._serve(self._deadline, enough)
        self.found.listened = time.monotonic() - began

    def _serve(self, deadline: float, enough: Callable[[], bool]) -> None:
        while not enough() and (left := deadline - time.monotonic()) > 0:
            try:
                self._inbox.get(timeout=min(left, _LOOK_UP))()
            except Empty:
                continue

    def _posted(self, take: Callable[[zenoh.Reply], None]) -> Callable[[zenoh.Reply], None]:
        return lambda reply: self._inbox.put(lambda: take(reply))

    def _on_end(self) -> None:
        def end() -> None:
            self._pending -= 1

        self._inbox.put(end)

    def _on_token(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            self._timed_out = True
            return
        key = str(reply.ok.key_expr)
        if (node := keyexpr.node_of(key)) is not None:
            self.found.nodes.append(node)
        elif (offer := keyexpr.offer_of(key)) is not None:
            self.found.offers.append(offer)

    def _samples(self, key: str) -> Callable[[zenoh.Sample], None]:
        stats = self.found.topics[key]

        def on_sample(sample: zenoh.Sample) -> None:
            now, payload, stamp = time.monotonic(), sample.payload.to_bytes(), sample.timestamp
            source = str(stamp.get_id()) if stamp else ""
            age = time.time() - stamp.get_time().timestamp() if stamp else 0.0
            self._inbox.put(lambda: stats.take(now, payload, source, age))

        return on_sample

    def _replies(self, key: str) -> Callable[[zenoh.Reply], None]:
        began = time.monotonic()

        def on_reply(reply: zenoh.Reply) -> None:
            answer = answer_of(reply, time.monotonic() - began)
            self._inbox.put(lambda: self.found.answers[key].append(answer))

        return on_reply
