"""Transfers of missions and fences: the protocol of MAVLink, for one vehicle. Pure."""

from collections.abc import Callable, Sequence
from enum import IntEnum

from msgspec import Struct

from quadctl.services.mavlink.plan import MOST_ITEMS, Item
from quadctl.services.runtime.errors import QuadctlError

_AGAIN, _ATTEMPTS = 0.5, 8
"""Seconds until an item is requested again, and how often it is."""


class Kind(IntEnum):
    """Kind of plan, MAV_MISSION_TYPE; rally points are none of ours."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class Result(IntEnum):
    """End of a transfer, MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15


class Count(Struct, frozen=True):
    """Number of items of a plan that a peer may request now."""

    kind: Kind
    count: int


class Wanted(Struct, frozen=True):
    """Request for an item that a peer uploads."""

    kind: Kind
    number: int


class Sent(Struct, frozen=True):
    """Item of a download."""

    kind: Kind
    number: int
    item: Item


class Ended(Struct, frozen=True):
    """End of a transfer, and for the user why it failed."""

    kind: Kind
    result: Result
    reason: str = ""


Reply = Count | Wanted | Sent | Ended
Peer = tuple[int, int]
"""System and component of a ground station."""


class Upload(Struct):
    """Upload under way."""

    kind: Kind
    peer: Peer
    count: int
    items: list[Item]
    asked: float
    attempts: int = 1


class Store(Struct):
    """Plans of a vehicle: `load` returns one, `save` takes one; both raise QuadctlError."""

    load: Callable[[Kind], Sequence[Item]]
    save: Callable[[Kind, Sequence[Item]], None]


class Transfers:
    """Transfers of one vehicle: one upload at a time, and any number of downloads."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._upload: Upload | None = None

    @property
    def peer(self) -> Peer | None:
        """Return who uploads now."""
        return self._upload.peer if self._upload else None

    def on_count(self, peer: Peer, kind: Kind, count: int, now: float) -> Reply:
        """Begin an upload; an earlier one of the same peer is given up."""
        if self._upload and self._upload.peer != peer:
            return Ended(kind, Result.DENIED, "another ground station uploads a plan")
        self._upload = None
        if kind == Kind.RALLY and count:
            return Ended(kind, Result.UNSUPPORTED, "the vehicle has no rally points")
        if count > MOST_ITEMS:
            return Ended(kind, Result.NO_SPACE, f"{count} items: at most {MOST_ITEMS} are allowed")
        if count == 0:
            return self._save(kind, [])
        self._upload = Upload(kind, peer, count, [], now)
        return Wanted(kind, 0)

    def on_item(self, peer: Peer, kind: Kind, number: int, item: Item, now: float) -> Reply | None:
        """Take an item, and request the next one; a repeated one changes nothing."""
        upload = self._upload
        if upload is None or (upload.peer, upload.kind) != (peer, kind):
            return None
        if number != len(upload.items):
            return None  # the one that is missing is requested again
        upload.items.append(item)
        upload.asked, upload.attempts = now, 1
        if len(upload.items) < upload.count:
            return Wanted(kind, len(upload.items))
        self._upload = None
        return self._save(kind, upload.items)

    def on_list(self, kind: Kind) -> Reply:
        """Begin a download."""
        try:
            return Count(kind, len(self._load(kind)))
        except QuadctlError as problem:
            return Ended(kind, Result.UNSUPPORTED, problem.message)

    def on_request(self, kind: Kind, number: int) -> Reply:
        """Return an item of a download."""
        try:
            items = self._load(kind)
        except QuadctlError as problem:
            return Ended(kind, Result.UNSUPPORTED, problem.message)
        if not 0 <= number < len(items):
            return Ended(kind, Result.INVALID_SEQUENCE)
        return Sent(kind, number, items[number])

    def on_clear(self, kind: Kind) -> Reply:
        """Delete a plan."""
        return self._save(kind, [])

    def on_ack(self, peer: Peer, kind: Kind) -> None:
        """Take the end of a transfer by a peer: it gives up its upload."""
        if self._upload and (self._upload.peer, self._upload.kind) == (peer, kind):
            self._upload = None

    def tick(self, now: float) -> Reply | None:
        """Return a request that has to be sent again, or the end of an upload that nobody continues."""
        upload = self._upload
        if upload is None or now < upload.asked + _AGAIN:
            return None
        if upload.attempts == _ATTEMPTS:
            self._upload = None
            return Ended(upload.kind, Result.CANCELLED, "the upload of a plan was not continued")
        upload.asked, upload.attempts = now, upload.attempts + 1
        return Wanted(upload.kind, len(upload.items))

    def _load(self, kind: Kind) -> Sequence[Item]:
        return [] if kind == Kind.RALLY else self._store.load(kind)

    def _save(self, kind: Kind, items: Sequence[Item]) -> Reply:
        if kind != Kind.RALLY:
            try:
                self._store.save(kind, items)
            except QuadctlError as problem:
                return Ended(kind, Result.UNSUPPORTED, problem.message)
        return Ended(kind, Result.ACCEPTED)
