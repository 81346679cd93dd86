"""A command's way onto the bus: connects at once or fails at once, and never hangs."""

import contextlib
import time
from typing import TYPE_CHECKING, Self, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service, Topic
from services.runtime import graph, roster, wire
from services.runtime.calls import Asker, Caller
from services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable
from services.runtime.realm import Realm
from services.runtime.record import is_live, not_running
from services.runtime.session import address_of, open_client

if TYPE_CHECKING:
    from services.runtime.hearing import Readings, Stream
    from services.runtime.outlet import Outlet

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


class Client:
    """One connection to a realm's hub, for as long as a `with` block lasts."""

    def __init__(
        self, realm: str, vehicle: str, *, connect: str = "", timeout: float = 3.0
    ) -> None:
        """`timeout` (s) bounds every reply. Raises Unreachable when no hub is there."""
        self.vehicle, self.timeout = vehicle, timeout
        self._session = _connect(Realm(realm), connect, timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def call(self, service: Service[Q, R], request: Q, timeout: float | None = None) -> R:
        """Call a service once; raises Unreachable, TimedOut or what the server replied.

        `timeout` (s) is for a call that is one of several under one deadline.
        """
        caller = Caller(self._session, self.vehicle, service)
        return caller.call(request, self.timeout if timeout is None else timeout)

    def ask(self, key: str, payload: bytes, encoding: str) -> tuple[bytes, str]:
        """Ask whoever serves a key; returns the reply and its encoding, raises as `call`."""
        return Asker(self._session, key).ask(payload, encoding, self.timeout)

    def latest(self, topic: Topic[M]) -> M:
        """The last message of a latched topic."""
        key = topic.key(self.vehicle)
        deadline = time.monotonic() + self.timeout
        why: QuadctlError = Unreachable(
            f"nobody answered for {key} within {self.timeout:g} s",
            f"is {topic.node} up? `quadctl status` shows it",
        )
        while (left := deadline - time.monotonic()) > 0:
            # Of all who answer: a stranger's nonsense must not hide the topic's own reply.
            for reply in self._session.get(
                key,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=left,
            ):
                if reply.ok is None:
                    why = TimedOut(
                        f"{topic.node} did not answer within {self.timeout:g} s",
                        "its process is busy or frozen: `quadctl status` shows which",
                    )
                    continue
                try:
                    payload, said = reply.ok.payload.to_bytes(), str(reply.ok.encoding)
                    return wire.decode(topic.type, payload, said)
                except Invalid as problem:
                    why = self._only_unread(wire.unreadable(key, problem))
            # Nobody answers for the key yet; a restart takes a tenth of a second.
            time.sleep(max(min(deadline - time.monotonic(), 0.02), 0))
        raise why

    def first(self, topic: Topic[M]) -> M:
        """The next message of a topic."""
        readings = self.hear(topic)
        message = readings.next(self.timeout)
        if message is None:
            raise self.silent(topic.key(self.vehicle), readings.unread)
        return message

    def hear(self, *topics: Topic[M]) -> "Readings[M]":
        """Hear topics, decoded."""
        from services.runtime.hearing import Readings

        types = {topic.key(self.vehicle): topic.type for topic in topics}
        return Readings(self.listen(*types), types)

    def listen(self, *keys: str) -> "Stream":
        """Hear keys or key expressions."""
        from services.runtime.hearing import Stream

        return Stream(self._session, keys)

    def silent(self, key: str, unread: Invalid | None = None) -> QuadctlError:
        """Why nothing came on a key or key expression.

        What came could not be read; its publisher is quiet; or there is none.
        """
        if unread is not None:
            return self._only_unread(unread)
        for offer in self.offers():
            if offer.kind == "@pub" and _covers(key, offer.key):
                return TimedOut(
                    f"nothing came on {key} within {self.timeout:g} s, although {offer.node}"
                    " publishes it",
                    "its process is busy, frozen, or waits for another: `quadctl status`",
                )
        return Unreachable(
            f"nothing came on {key} within {self.timeout:g} s: nobody publishes it",
            "`quadctl topic list` shows what there is",
        )

    def _only_unread(self, unread: Invalid) -> Invalid:
        text = f"nothing that can be read came within {self.timeout:g} s: {unread.message}"
        return Invalid(text, unread.hint)

    def outlet(self, key: str, encoding: str = "") -> "Outlet":
        """Publish on a key."""
        from services.runtime.outlet import Outlet

        return Outlet(self._session, key, encoding)

    def flush(self) -> None:
        """Return once the hub has read all that was sent before."""
        self.nodes()

    def nodes(self) -> list[str]:
        """The ready nodes."""
        return roster.nodes(self._session, self.vehicle)

    def offers(self) -> list[graph.Offer]:
        """The topics and services of the ready nodes."""
        return roster.offers(self._session, self.vehicle)


def _covers(pattern: str, key: str) -> bool:
    if "*" not in pattern:
        return pattern == key
    try:
        return zenoh.KeyExpr(pattern).intersects(zenoh.KeyExpr(key))
    except zenoh.ZError:
        # A stranger may announce what is no key.
        return False


def _connect(realm: Realm, connect: str, timeout: float) -> zenoh.Session:
    """Connect at once, or fail at once; only a hub that is being restarted is waited for."""
    address, began = address_of(realm, connect), time.monotonic()
    try:
        return open_client(address, timeout=timeout)
    except Unreachable:
        if connect:
            raise
        if not is_live(realm):
            raise not_running(realm) from None
        left = timeout - (time.monotonic() - began)
        if left > 0:
            with contextlib.suppress(Unreachable):
                return open_client(address, wait=left, timeout=left)
        raise Unreachable(
            f"the realm {realm.name} is up, but its hub did not answer within {timeout:g} s",
            "it is restarted by itself; where that does not help: `quadctl down`, `quadctl up`",
        ) from None
