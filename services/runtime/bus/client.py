"""Command side of the bus: Client, its hub connection and pace, latched get, raw publisher."""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Self, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas import keyexpr
from quadctl.schemas.topics import Service, Topic, topic_of
from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.bus.calls import RawServiceClient, ServiceClient
from quadctl.services.runtime.bus.session import (
    abandon_in_fork,
    close,
    connect_to_hub,
    forked,
)
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.realm import Realm, vehicle_name
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.typed import argument, positive_time, require

if TYPE_CHECKING:
    from quadctl.schemas.roles import Right
    from quadctl.services.runtime.bus.replay import ReplayPublisher
    from quadctl.services.runtime.bus.streams import QueuedSubscriber, TypedSubscriber

T = TypeVar("T")

_LOSING = 0.05
"""Longest time (s) until Zenoh reports that a connection is lost."""


class HubConnection:
    """Check that the hub is there and is still the first one; `realm` is that of a local hub."""

    def __init__(self, session: zenoh.Session, realm: Realm | None) -> None:
        self._session, self._realm = session, realm
        self.is_closed = self.is_forked = False
        abandon_in_fork(self)
        self._since, self._first = time.monotonic(), self._hubs()
        self._breaks: zenoh_events.DisconnectListener | None = None

    def watch(self) -> None:
        """Detect from now on each loss of the connection, even a short one; for publishers."""
        self._breaks = self._breaks or zenoh_events.DisconnectListener(self._session)

    @property
    def is_there(self) -> bool:
        """Return whether the session is connected."""
        return bool(self._session.info.routers_zid())

    def answered(self, found: list[T]) -> list[T]:
        """Return `found` if the hub answered; raise Unreachable or TimedOut if it is lost."""
        # Without a connection Zenoh answers at once, with our own declarations or with nothing. It
        # does so a moment before it reports that the connection is lost.
        deadline = time.monotonic() + _LOSING
        while self.is_there:
            if found or time.monotonic() > deadline:
                return found
            time.sleep(_LOSING / 10)
        raise self._lost()

    def check_unbroken(self) -> None:
        """Raise Unreachable if sent messages may be lost, even if the connection is back.

        A session reconnects by itself: to a new hub, which has none of them, or after a break.
        """
        if not self._first & self._hubs():
            raise self._lost()
        if self._breaks and self._breaks.fired():
            raise Unreachable(
                "the connection to the hub was lost for a moment: messages sent then are lost",
                "send them again; the hub was busy or frozen for longer than a second",
            )

    def _hubs(self) -> set[str]:
        return {str(hub) for hub in self._session.info.routers_zid()}

    def _lost(self) -> QuadctlError:
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.hub_lost(self._realm, self._since)


M = TypeVar("M", bound=Struct)

_AGAIN = 0.02
"""Seconds between queries until a publisher is there: a restart takes 0.1 s."""


def latest(session: zenoh.Session, topic: Topic[M], key: str, timeout: float) -> M:
    """Return the last message of a topic.

    Raises Unreachable if no publisher is there within the timeout (s), TimedOut if one is there but
    does not answer, and Invalid if only unreadable messages came.
    """
    deadline = time.monotonic() + timeout
    why: QuadctlError = Unreachable(
        f"nobody answered for {key} within {timeout:g} s",
        f"is {topic.node} up? `quadctl status` shows it",
    )
    while (left := deadline - time.monotonic()) > 0:
        # All answers are read: an invalid one from elsewhere must not hide the topic's own.
        for reply in session.get(key, timeout=left, **zenoh_events.ALL_SERVERS):
            if reply.ok is None:
                if isinstance(why, Invalid):
                    continue  # an unreadable answer explains more than a missing one
                why = TimedOut(
                    f"{topic.node} did not answer within {timeout:g} s",
                    "its process is busy or frozen: `quadctl status` shows which",
                )
                continue
            try:
                payload, encoding = reply.ok.payload.to_bytes(), str(reply.ok.encoding)
                return codec.decode(topic.type, payload, encoding)
            except Invalid as problem:
                why = codec.unreadable(key, problem)
        time.sleep(max(min(deadline - time.monotonic(), _AGAIN), 0))
    raise why


class RawPublisher:
    """Publisher of bytes on a key, for as long as its client's `with` block lasts."""

    def __init__(self, client: "Client", key: str, encoding: str) -> None:
        self._client, session = client, client.session
        # A typed message waits for room; only at a robot's rates would the next one replace it.
        self._publisher = session.declare_publisher(
            key,
            encoding=encoding or zenoh.Encoding.ZENOH_BYTES,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._listeners = zenoh_events.MatchingListener(self._publisher)

    def put(self, payload: bytes) -> None:
        """Publish one message; raise Unreachable after the client's `close`."""
        argument("a payload", payload, bytes, "bytes")
        self._client.session  # noqa: B018 - raises
        self._publisher.put(payload)

    def wait_for_listener(self, timeout: float) -> bool:
        """Wait up to a timeout (s) for a subscriber; return False if none came."""
        return self._listeners.wait(timeout)

    def has_subscribers(self) -> bool:
        """Return whether the hub has reported a subscriber; call it after a round trip to it."""
        return self._listeners.is_there


Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_BACKLOG = 10_000
"""Messages kept for a slow reader; beyond, the oldest are dropped."""

_lost: list["Client"] = []
"""Clients whose hub was gone, until the next one is there: with a frozen hub to close one, or to
collect its declarations, blocks for seconds."""


P = ParamSpec("P")


def _guarded(method: Callable[Concatenate[Any, P], T]) -> Callable[Concatenate[Any, P], T]:
    """Let a method raise our errors in place of Zenoh's: closed meanwhile, or a key that is none."""

    @wraps(method)
    def guarded(self: Any, /, *args: P.args, **options: P.kwargs) -> T:
        try:
            return method(self, *args, **options)
        except zenoh.ZError as error:
            self.session  # noqa: B018 - raises if it was closed meanwhile
            problem = str(error).partition(" at ")[0]
            if "Key Expr" in problem:
                hint = "a key is words between slashes, e.g. uav/pose"
                raise Invalid(problem, hint) from error
            raise QuadctlError(problem, "`quadctl doctor` looks at the connection") from error

    return guarded


class Client:
    """Connection to a realm's hub, for as long as a `with` block lasts.

    `timeout` (s) bounds every reply. Raises Unreachable without a hub, TimedOut if it is silent.
    """

    def __init__(self, realm: str, vehicle: str, *, connect: str = "", timeout: float = 3) -> None:
        argument("realm", realm, str, "a name")
        argument("vehicle", vehicle, str, "a name")
        self.vehicle, self.timeout = vehicle_name(vehicle), positive_time("timeout", timeout)
        self.realm, self._connect = Realm(realm), connect
        self._session = connect_to_hub(self.realm, connect, self.timeout)
        self._hub = HubConnection(self._session, None if connect else self.realm)
        self._held: list[object] = []
        self._own: set[str] = set()
        with suppress(IndexError):  # several threads may connect at a time
            while True:
                close(_lost.pop()._session)  # noqa: SLF001 - of the same class

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        closed = ", closed" if self._hub.is_closed else ""
        return f"<connection to {self.vehicle} on {self._place}{closed}>"

    @property
    def _place(self) -> str:
        return self._connect or f"the realm {self.realm.name}"

    @property
    def session(self) -> zenoh.Session:
        """Return the session; raise Unreachable after `close`."""
        if self._hub.is_forked:
            raise forked()
        if self._hub.is_closed:
            raise Unreachable(
                f"the connection to {self._place} is closed",
                "use it inside its `with` block, before close(); quadctl.connect() makes a new one",
            )
        return self._session

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        if self._hub.is_closed:
            return
        self._hub.is_closed = True
        if self._hub.is_there:
            close(self._session)
        else:
            _lost.append(self)

    @property
    def is_connected(self) -> bool:
        """Return whether the hub is there now."""
        return not self._hub.is_closed and self._hub.is_there

    @property
    def is_local(self) -> bool:
        """Return whether the hub is that of a realm on this machine."""
        return not self._connect

    def beside(self, vehicle: str, timeout: float) -> Self:
        """Return this connection for another vehicle's keys, with another timeout (s)."""
        from copy import copy

        other = copy(self)
        other.vehicle, other.timeout = vehicle, timeout
        return other

    def permit(self, right: "Right", *keys: str) -> None:
        """Raise NotAllowed if the role of our certificate does not permit the right on a key."""
        if self._connect:
            from quadctl.services.runtime.security import permissions

            permissions.check(self._connect, right, *keys)

    @_guarded
    def call(
        self, service: Service[Q, R], request: Q, timeout: float | None = None, boot: str = ""
    ) -> R:
        """Call a service once; raise Unreachable, TimedOut or the server's error.

        `timeout` (s): for one of several calls under one deadline. `boot`: the one a reset begins.
        """
        require(service, Service, "GOTO of quadctl.schemas.topics")
        key = service.key(self.vehicle)
        self.permit("call", key)
        try:
            caller = ServiceClient(self.session, self.vehicle, service)
            return caller.call(request, self._within(timeout), boot, again=bool(self._connect))
        except Unreachable as problem:
            raise self.explained(problem, service.node, key) from problem

    @_guarded
    def wait_for_server(self, service: Service[Q, R]) -> None:
        """Wait until the service has a server; raise as `call` if none comes."""
        require(service, Service, "GOTO of quadctl.schemas.topics")
        key = service.key(self.vehicle)
        self.permit("call", key)
        try:
            RawServiceClient(self.session, key).wait_for_server(self.timeout)
        except Unreachable as problem:
            raise self.explained(problem, service.node, key) from problem

    @_guarded
    def call_raw(self, key: str, payload: bytes, encoding: str) -> tuple[bytes, str]:
        """Call the server of a key; return the reply and its encoding, raise as `call`."""
        self.permit("call", key)
        try:
            return RawServiceClient(self.session, key).call(payload, encoding, self.timeout)
        except Unreachable as problem:
            raise self.explained(problem) from problem

    @_guarded
    def latest(self, topic: Topic[M]) -> M:
        """Return the last message of a latched topic; raise Invalid for another."""
        require(topic, Topic, "STATE of quadctl.schemas.topics")
        if not topic.latched:
            raise Invalid(f"{topic.name} is not latched", "`first` returns its next message")
        key = topic.key(self.vehicle)
        self.permit("read", key)
        try:
            return latest(self.session, topic, key, self.timeout)
        except Invalid as problem:
            raise self._only_unread(problem) from problem
        except Unreachable as problem:
            raise self.explained(problem, topic.node) from problem

    @_guarded
    def first(self, topic: Topic[M]) -> M:
        """Return the next message of a topic."""
        readings = self.subscribe(topic)
        try:
            message = readings.next(self.timeout)
        finally:
            readings.close()
        if message is None:
            raise self.silent(topic.key(self.vehicle), readings.problem)
        return message

    def subscribe(
        self, *topics: Topic[M], backlog: int = _BACKLOG, held: bool = False
    ) -> "TypedSubscriber[M]":
        """Subscribe to topics, decoded; see `listen`."""
        from quadctl.services.runtime.bus.streams import TypedSubscriber

        for topic in topics:
            require(topic, Topic, "POSE of quadctl.schemas.topics")
        types = {topic.key(self.vehicle): topic.type for topic in topics}
        return TypedSubscriber(self.listen(*types, backlog=backlog, held=held), types)

    @_guarded
    def listen(self, *keys: str, backlog: int = _BACKLOG, held: bool = False) -> "QueuedSubscriber":
        """Subscribe to keys or key expressions; up to `backlog` messages wait for their reader.

        With `held`, the last message of each latched topic comes before its others.
        """
        from quadctl.services.runtime.bus.streams import QueuedSubscriber

        for key in keys:
            argument("a key", key, str, "a text")
        self.permit("listen", *keys)
        stream = QueuedSubscriber(self.session, keys, backlog)
        for key in keys if held else ():
            if (topic := topic_of(key)) is not None and topic.latched:
                stream.request_latched(key)
        return stream

    def silent(
        self, key: str, unread: Invalid | None = None, *, more: bool = False
    ) -> QuadctlError:
        """Return why nothing, or no `more`, came on a key: unreadable, quiet or no publisher."""
        if unread is not None:
            return self._only_unread(unread)
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.explain_silence(self, key, more=more)

    def explained(
        self, problem: Unreachable, node: str = "", key: str = "", live: list[str] | None = None
    ) -> QuadctlError:
        """Return the problem with its reason; TimedOut if `node`, the known server, is frozen.

        NotAllowed if the hub denies us a `key` that is served. `live`: the ready nodes, if known.
        """
        if self._hub.is_closed:
            return problem
        from quadctl.services.runtime.bus import diagnosis

        return diagnosis.explain_unreachable(self, self._connect, problem, node, key, live)

    def silent_processes(
        self, timeout: float | None = None, live: list[str] | None = None
    ) -> list[ProcessRecord]:
        """Return the nodes of this machine's run that are there but lost to the hub."""
        from quadctl.services.runtime.bus import diagnosis

        live = self.nodes(timeout) if live is None else live
        return [] if self._connect else diagnosis.silent_processes(self.realm, self.vehicle, live)

    def _only_unread(self, unread: Invalid) -> Invalid:
        came = f"no readable message came within {self.timeout:g} s"
        return Invalid(f"{came}: {unread.message}", unread.hint)

    @_guarded
    def raw_publisher(self, key: str, encoding: str = "") -> RawPublisher:
        """Return a publisher of bytes on a key."""
        argument("a key", key, str, "a text")
        self.session  # noqa: B018 - raises if it is closed
        self.permit("publish", key)
        self._hub.watch()
        publisher = RawPublisher(self, key, encoding)
        self._held.append(publisher)
        return publisher

    @_guarded
    def stage(self, keys: dict[str, str]) -> "ReplayPublisher":
        """Return a publisher that replays keys, each with its encoding; raise AlreadyServed."""
        from quadctl.services.runtime.bus import replay

        self.session  # noqa: B018 - raises if it is closed
        self.permit("publish", *keys)
        self._hub.watch()
        self._own.add(replay.NAME)
        return replay.ReplayPublisher(self.session, keys)

    @_guarded
    def flush(self, timeout: float | None = None) -> None:
        """Wait until the hub has read everything sent; raise as `nodes`, or if some may be lost."""
        found = liveliness.nodes(self.session, self.vehicle, self._within(timeout))
        # Our own tokens are found without a hub.
        self._hub.answered([node for node in found if node not in self._own])
        self._hub.check_unbroken()

    @_guarded
    def nodes(self, timeout: float | None = None, *, of: str = "") -> list[str]:
        """Return the ready nodes of this vehicle, or of another one.

        Raises TimedOut if the hub does not answer in time (s), Unreachable if it has ended.
        """
        return self._hub.answered(
            liveliness.nodes(self.session, of or self.vehicle, self._within(timeout))
        )

    @_guarded
    def vehicles(self) -> list[str]:
        """Return the vehicles that have a ready node; raise as `nodes`."""
        return self._hub.answered(liveliness.vehicles(self.session, self.timeout))

    @_guarded
    def endpoints(
        self, *kinds: keyexpr.Kind, of: str = "", timeout: float | None = None
    ) -> list[keyexpr.EndpointInfo]:
        """Return the ready nodes' endpoints of these kinds, by default what they offer.

        They are those of this vehicle, of another one, or with `*` of all. Raises as `nodes`.
        """
        kinds = kinds or ("@pub", "@srv")
        within = self._within(timeout)
        return self._hub.answered(
            liveliness.offers(self.session, of or self.vehicle, *kinds, timeout=within)
        )

    def _within(self, timeout: float | None) -> float:
        return self.timeout if timeout is None else positive_time("timeout", timeout)


class Pace:
    """Pacing of a sender that checks the hub twice within the client's timeout.

    Messages to a dead hub are lost without an error: the check reports it, however long the pause.
    """

    def __init__(self, client: Client) -> None:
        self._client, self._checked = client, time.monotonic()

    def sleep_until(self, until: float) -> None:
        """Sleep until a time (monotonic s); raise as `check` does as soon as a check is due."""
        half = self._client.timeout / 2
        while (now := time.monotonic()) < until or now > self._checked + half:
            time.sleep(max(min(until, self._checked + half) - now, 0))
            if time.monotonic() > self._checked + half:
                self.check()

    def check(self) -> None:
        """Wait until the hub confirms all that was sent; raise as Client.flush does."""
        # The rest of the timeout since the last check; at least half of it, as we may be late.
        left = self._checked + self._client.timeout - time.monotonic()
        self._client.flush(max(left, self._client.timeout / 2))
        self._checked = time.monotonic()
