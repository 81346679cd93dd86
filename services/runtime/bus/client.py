"""Command side of the bus: Client, the watch on its hub connection, latched get, raw publisher."""

import time
from typing import TYPE_CHECKING, Self, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas import keyexpr
from quadctl.schemas.topics import Service, Topic, topic_of
from quadctl.services.runtime.bus import codec, liveliness
from quadctl.services.runtime.bus.calls import RawServiceClient, ServiceClient
from quadctl.services.runtime.bus.session import connect_to_hub
from quadctl.services.runtime.bus.zenoh_events import (
    ALL_SERVERS,
    DisconnectListener,
    MatchingListener,
)
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord

if TYPE_CHECKING:
    from quadctl.schemas.roles import Right
    from quadctl.services.runtime.bus.raw import ReplayPublisher
    from quadctl.services.runtime.bus.streams import RawSubscriber, TypedSubscriber

T = TypeVar("T")

_LOSING = 0.05
"""Seconds in which it is known that a connection is lost, at most."""


class HubConnection:
    """Whether the hub is there, and whether it is the one that was there at first."""

    def __init__(self, session: zenoh.Session, realm: Realm | None) -> None:
        """`realm` is the hub's, where it is one of this machine."""
        self._session, self._realm = session, realm
        self._since, self._first = time.time(), self._hubs()
        self._breaks: DisconnectListener | None = None

    def watch(self) -> None:
        """From now on see that the connection is lost, though it come back; for who sends."""
        self._breaks = self._breaks or DisconnectListener(self._session)

    @property
    def is_there(self) -> bool:
        """Whether the session is connected."""
        return bool(self._session.info.routers_zid())

    def answered(self, found: list[T]) -> list[T]:
        """What the hub has answered; raises Unreachable or TimedOut where it was nobody's answer."""
        # Without a connection there is nobody to ask, and the answer is what we have ourselves, or
        # empty at once. Of one that is being lost it is so a moment before that is known.
        deadline = time.monotonic() + _LOSING
        while self.is_there:
            if found or time.monotonic() > deadline:
                return found
            time.sleep(_LOSING / 10)
        raise self._lost()

    def check_unbroken(self) -> None:
        """Raise Unreachable where a part of what was sent may be lost, though all is well again.

        A session comes back by itself: to another hub, which has nothing of what the first was sent,
        or to the same one, from which it was cut off.
        """
        if not self._first & self._hubs():
            raise self._lost()
        if self._breaks and self._breaks.fired():
            raise Unreachable(
                "the connection to the hub was lost for a moment: what was sent then has not come",
                "send it again; the hub was busy or frozen for longer than a second",
            )

    def _hubs(self) -> set[str]:
        return {str(hub) for hub in self._session.info.routers_zid()}

    def _lost(self) -> QuadctlError:
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.hub_lost(self._realm, self._since)


M = TypeVar("M", bound=Struct)

_AGAIN = 0.02
"""Seconds after which one is asked again who was not there: a restart takes a tenth of one."""


def latest(session: zenoh.Session, topic: Topic[M], key: str, timeout: float) -> M:
    """The last message of a topic.

    Raises Unreachable where nobody answers within the timeout (s), TimedOut where who is there does
    not, and Invalid where only what cannot be read has come.
    """
    deadline = time.monotonic() + timeout
    why: QuadctlError = Unreachable(
        f"nobody answered for {key} within {timeout:g} s",
        f"is {topic.node} up? `quadctl status` shows it",
    )
    while (left := deadline - time.monotonic()) > 0:
        # Of all who answer: a stranger's nonsense must not hide the topic's own reply.
        for reply in session.get(key, timeout=left, **ALL_SERVERS):
            if reply.ok is None:
                if isinstance(why, Invalid):
                    continue  # that something came says more than that no more did
                why = TimedOut(
                    f"{topic.node} did not answer within {timeout:g} s",
                    "its process is busy or frozen: `quadctl status` shows which",
                )
                continue
            try:
                payload, said = reply.ok.payload.to_bytes(), str(reply.ok.encoding)
                return codec.decode(topic.type, payload, said)
            except Invalid as problem:
                why = codec.unreadable(key, problem)
        # Nobody answers for the key yet.
        time.sleep(max(min(deadline - time.monotonic(), _AGAIN), 0))
    raise why


class RawPublisher:
    """Publishes bytes on a key, for as long as its client's `with` block lasts."""

    def __init__(self, session: zenoh.Session, key: str, encoding: str) -> None:
        # A message that somebody typed waits for room; at a robot's rates the next would do.
        self._publisher = session.declare_publisher(
            key,
            encoding=encoding or zenoh.Encoding.ZENOH_BYTES,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._listeners = MatchingListener(self._publisher)

    def put(self, payload: bytes) -> None:
        """Publish one message."""
        self._publisher.put(payload)

    def wait_for_listener(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for somebody who listens; False where nobody came."""
        return self._listeners.wait(timeout)

    def is_heard(self) -> bool:
        """Whether anybody listens, as far as the hub has said; ask after a round trip to it."""
        return self._listeners.is_there


Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_BACKLOG = 10_000
"""Messages kept for a slow reader; the oldest go first beyond."""

_lost: list["Client"] = []
"""Whose hub is gone, kept as they are: to close one, or drop what it has declared, takes a second."""


class Client:
    """One connection to a realm's hub, for as long as a `with` block lasts."""

    def __init__(self, realm: str, vehicle: str, *, connect: str = "", timeout: float = 3) -> None:
        """`timeout` (s) bounds every reply.

        Raises Unreachable when no hub is there, TimedOut when it does not answer.
        """
        self.vehicle, self.timeout = vehicle, timeout
        self.realm, self._connect = Realm(realm), connect
        self.session = connect_to_hub(self.realm, connect, timeout)
        self._hub = HubConnection(self.session, None if connect else self.realm)
        self._held: list[object] = []
        self._own: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._hub.is_there:
            self.session.close()
        else:
            _lost.append(self)

    def beside(self, vehicle: str, timeout: float) -> Self:
        """The same connection for another vehicle's keys, with a timeout (s) of its own."""
        from copy import copy

        other = copy(self)
        other.vehicle, other.timeout = vehicle, timeout
        return other

    def permit(self, right: "Right", *keys: str) -> None:
        """Raise NotAllowed where the role that our certificate gives does not extend to a key."""
        if self._connect:
            from quadctl.services.runtime.security import permissions

            permissions.check(self._connect, right, *keys)

    def call(
        self, service: Service[Q, R], request: Q, timeout: float | None = None, boot: str = ""
    ) -> R:
        """Call a service once; raises Unreachable, TimedOut or what the server replied.

        `timeout` (s) is for a call that is one of several under one deadline; `boot` names the
        boot that a reset is to begin.
        """
        self.permit("call", service.key(self.vehicle))
        try:
            caller = ServiceClient(self.session, self.vehicle, service)
            return caller.call(request, self._within(timeout), boot, again=bool(self._connect))
        except Unreachable as problem:
            raise self.explained(problem, service.node, service.key(self.vehicle)) from problem

    def wait_for_server(self, service: Service[Q, R]) -> None:
        """Return when somebody serves it; raises as `call` where nobody does."""
        key = service.key(self.vehicle)
        self.permit("call", key)
        try:
            RawServiceClient(self.session, key).wait_for_server(self.timeout)
        except Unreachable as problem:
            raise self.explained(problem, service.node, key) from problem

    def ask(self, key: str, payload: bytes, encoding: str) -> tuple[bytes, str]:
        """Ask whoever serves a key; returns the reply and its encoding, raises as `call`."""
        self.permit("call", key)
        try:
            return RawServiceClient(self.session, key).call(payload, encoding, self.timeout)
        except Unreachable as problem:
            raise self.explained(problem) from problem

    def latest(self, topic: Topic[M]) -> M:
        """The last message of a latched topic."""
        key = topic.key(self.vehicle)
        self.permit("read", key)
        try:
            return latest(self.session, topic, key, self.timeout)
        except Invalid as problem:
            raise self._only_unread(problem) from problem
        except Unreachable as problem:
            raise self.explained(problem, topic.node) from problem

    def first(self, topic: Topic[M]) -> M:
        """The next message of a topic."""
        readings = self.subscribe(topic)
        message = readings.next(self.timeout)
        if message is None:
            raise self.silent(topic.key(self.vehicle), readings.unread)
        return message

    def subscribe(self, *topics: Topic[M], backlog: int = _BACKLOG) -> "TypedSubscriber[M]":
        """Hear topics, decoded; up to `backlog` messages wait for their reader."""
        from quadctl.services.runtime.bus.streams import TypedSubscriber

        types = {topic.key(self.vehicle): topic.type for topic in topics}
        return TypedSubscriber(self.listen(*types, backlog=backlog), types)

    def listen(self, *keys: str, backlog: int = _BACKLOG, held: bool = False) -> "RawSubscriber":
        """Hear keys or key expressions; up to `backlog` messages wait for their reader.

        With what latched topics `held` before, it comes first.
        """
        from quadctl.services.runtime.bus.streams import RawSubscriber

        self.permit("listen", *keys)
        stream = RawSubscriber(self.session, keys, backlog)
        for key in keys if held else ():
            if (topic := topic_of(key)) is not None and topic.latched:
                stream.ask(self.session, key, self.timeout)
        self._held.append(stream)
        return stream

    def silent(
        self, key: str, unread: Invalid | None = None, *, more: bool = False
    ) -> QuadctlError:
        """Why nothing came on a key or key expression, or no `more`.

        What came could not be read; its publisher is quiet; or there is none.
        """
        if unread is not None:
            return self._only_unread(unread)
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.explain_silence(self, key, more=more)

    def explained(
        self, problem: Unreachable, node: str = "", key: str = "", live: list[str] | None = None
    ) -> QuadctlError:
        """Why nobody answers, of `node` where it is known who should; TimedOut if that is frozen.

        NotAllowed where the hub keeps us from a `key` that is served. `live` are the ready nodes,
        where the hub has just told them: it is not asked again.
        """
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.explain_unreachable(self, self._connect, problem, node, key, live)

    def silent_processes(
        self, timeout: float | None = None, live: list[str] | None = None
    ) -> list[ProcessRecord]:
        """Nodes of this machine's run that are there, and that the hub takes for gone."""
        from quadctl.services.runtime.bus import diagnosis

        live = self.nodes(timeout) if live is None else live
        return [] if self._connect else diagnosis.silent_processes(self.realm, self.vehicle, live)

    def _only_unread(self, unread: Invalid) -> Invalid:
        said = f"nothing that can be read came within {self.timeout:g} s: {unread.message}"
        return Invalid(said, unread.hint)

    def raw_publisher(self, key: str, encoding: str = "") -> RawPublisher:
        """Publish on a key."""
        self.permit("publish", key)
        self._hub.watch()
        outlet = RawPublisher(self.session, key, encoding)
        self._held.append(outlet)
        return outlet

    def stage(self, keys: dict[str, str]) -> "ReplayPublisher":
        """Play the part of all who once published on keys, each with its encoding.

        Raises AlreadyServed where somebody has one of them.
        """
        from quadctl.services.runtime.bus import raw

        self.permit("publish", *keys)
        self._hub.watch()
        self._own.add(raw.NAME)
        return raw.ReplayPublisher(self.session, keys)

    def flush(self, timeout: float | None = None) -> None:
        """Return once the hub has read all that was sent before; raises as `nodes`.

        Unreachable also where the connection was lost meanwhile, or the hub restarted.
        """
        found = liveliness.nodes(self.session, self.vehicle, self._within(timeout))
        # Of what we are ourselves we hear without a hub.
        self._hub.answered([node for node in found if node not in self._own])
        self._hub.check_unbroken()

    def nodes(self, timeout: float | None = None) -> list[str]:
        """The ready nodes.

        Raises TimedOut where the hub does not answer in time (s), Unreachable where it has ended.
        """
        return self._hub.answered(
            liveliness.nodes(self.session, self.vehicle, self._within(timeout))
        )

    def vehicles(self) -> list[str]:
        """The vehicles that have a ready node; raises as `nodes`."""
        return self._hub.answered(liveliness.vehicles(self.session, self.timeout))

    def endpoints(self, timeout: float | None = None) -> list[keyexpr.EndpointInfo]:
        """The topics and services of the ready nodes; raises as `nodes`."""
        return self._hub.answered(
            liveliness.offers(self.session, self.vehicle, self._within(timeout))
        )

    def _within(self, timeout: float | None) -> float:
        return self.timeout if timeout is None else timeout
