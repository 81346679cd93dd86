"""Transfers of missions and fences, both sides of the protocol of MAVLink. Pure."""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, Literal, Protocol

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.bridges.mavlink.plan import MOST_ITEMS, PlanItem, degrees_e7
from quadctl.services.runtime.errors import Invalid, QuadctlError

AGAIN, ATTEMPTS = 0.5, 8
"""Seconds until an item is requested again, and how often it is."""
Peer = tuple[int, int]
"""System and component of a ground station."""


class PlanKind(IntEnum):
    """Kind of plan, MAV_MISSION_TYPE; we have no rally points."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class PlanStore(Protocol):
    """Plans of a vehicle; both methods raise QuadctlError."""

    def load(self, kind: PlanKind) -> Sequence[PlanItem]:
        """Return the items of a plan."""

    def save(self, kind: PlanKind, items: Sequence[PlanItem]) -> None:
        """Take a plan in the place of the present one."""


class IncomingPlan(Struct):
    """Upload under way. `asked` is when the next item was requested (s), for the `attempts`-th time."""

    kind: PlanKind
    peer: Peer
    count: int
    items: list[PlanItem]
    asked: float
    attempts: int = 1

    def wanted(self) -> Any:
        """Return the request for the next item."""
        return mavlink.MAVLink_mission_request_int_message(*self.peer, len(self.items), self.kind)


class Transfer(Struct, frozen=True):
    """Reply to a message: messages for the peer, and a reason for the user if there is one."""

    messages: Sequence[Any] = ()
    reason: str = ""


class Transfers:
    """Transfers of one vehicle: one upload at a time, and any number of downloads."""

    MESSAGES = (
        "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_REQUEST_LIST", "MISSION_REQUEST",
        "MISSION_REQUEST_INT", "MISSION_CLEAR_ALL", "MISSION_ACK",
    )  # fmt: skip
    """Types of the messages that `take` takes."""

    def __init__(self, store: PlanStore) -> None:
        self._store = store
        self._upload: IncomingPlan | None = None
        self._ended: tuple[IncomingPlan, Transfer] | None = None
        self._listed: dict[PlanKind, Sequence[PlanItem]] = {}

    @property
    def uploading(self) -> bool:
        """Return whether an upload is under way."""
        return self._upload is not None

    def take(self, message: Any, now: float) -> Transfer:
        """Take a message of a peer, and return the reply."""
        peer = message.get_srcSystem(), message.get_srcComponent()
        type_, number = message.get_type(), message.mission_type
        if type_ == "MISSION_CLEAR_ALL" and number == mavlink.MAV_MISSION_TYPE_ALL:
            reasons = [self._save(peer, kind, []).reason for kind in PlanKind]
            reason = next(filter(None, reasons), "")
            result = mavlink.MAV_MISSION_UNSUPPORTED if reason else mavlink.MAV_MISSION_ACCEPTED
            return Transfer([_ack(peer, result, number)], reason)
        if number not in {*PlanKind}:
            return Transfer([_ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, number)])
        kind = PlanKind(number)
        match type_:
            case "MISSION_COUNT":
                return self._on_count(peer, kind, message.count, now)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                return self._on_item(peer, kind, message, now)
            case "MISSION_CLEAR_ALL":
                return self._save(peer, kind, [])
            case "MISSION_ACK":
                if self._uploads(peer, kind):
                    self._upload = None
                return Transfer()
        if type_ == "MISSION_REQUEST_LIST":
            try:
                items = self._store.load(kind) if kind != PlanKind.RALLY else []
            except QuadctlError as problem:
                return _refused(peer, kind, problem)
            # A plan that changes meanwhile is not mixed into the download.
            self._listed[kind] = items
            return Transfer([mavlink.MAVLink_mission_count_message(*peer, len(items), kind)])
        items = self._listed.get(kind, [])
        if not 0 <= message.seq < len(items):
            return Transfer([_ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)])
        return Transfer([item_message(peer, kind, message.seq, items[message.seq])])

    def tick(self, now: float) -> Transfer:
        """Return a request that has to be sent again, or the end of an upload that nobody continues."""
        upload = self._upload
        if upload is None or now < upload.asked + AGAIN:
            return Transfer()
        if upload.attempts == ATTEMPTS:
            self._upload = None
            cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
            ended = _ack(upload.peer, cancelled, upload.kind)
            return Transfer([ended], "the upload of a plan was not continued")
        upload.asked, upload.attempts = now, upload.attempts + 1
        return Transfer([upload.wanted()])

    def _on_count(self, peer: Peer, kind: PlanKind, count: int, now: float) -> Transfer:
        """Begin an upload; an earlier one of the same peer is given up."""
        if self._upload and self._upload.peer != peer:
            return Transfer(
                [_ack(peer, mavlink.MAV_MISSION_DENIED, kind)],
                "another ground station uploads a plan",
            )
        self._upload = self._ended = None
        if count > MOST_ITEMS:
            return Transfer(
                [_ack(peer, mavlink.MAV_MISSION_NO_SPACE, kind)],
                f"{count} items: at most {MOST_ITEMS} are allowed",
            )
        if count == 0:
            return self._save(peer, kind, [])
        if kind == PlanKind.RALLY:
            return _refused(peer, kind, Invalid("the vehicle has no rally points"))
        self._upload = IncomingPlan(kind, peer, count, [], now)
        return Transfer([self._upload.wanted()])

    def _on_item(self, peer: Peer, kind: PlanKind, m: Any, now: float) -> Transfer:
        if self._ended and m.seq == self._ended[0].count - 1:
            ended, reply = self._ended
            if self._upload is None and (ended.peer, ended.kind) == (peer, kind):
                # The reply to the last item was lost.
                return reply
        upload = self._upload
        # A missing item is requested again by `tick`; a repeated one changes nothing.
        if upload is None or not self._uploads(peer, kind) or m.seq != len(upload.items):
            return Transfer()
        params = (m.param1, m.param2, m.param3, m.param4)
        goes_on = bool(m.autocontinue)
        upload.items.append(PlanItem(m.frame, m.command, params, *_places(m), m.z, goes_on))
        upload.asked, upload.attempts = now, 1
        if len(upload.items) < upload.count:
            return Transfer([upload.wanted()])
        self._upload = None
        reply = self._save(peer, kind, upload.items)
        self._ended = upload, reply
        return reply

    def _uploads(self, peer: Peer, kind: PlanKind) -> bool:
        return self._upload is not None and (self._upload.peer, self._upload.kind) == (peer, kind)

    def _save(self, peer: Peer, kind: PlanKind, items: Sequence[PlanItem]) -> Transfer:
        if kind != PlanKind.RALLY:
            try:
                self._store.save(kind, items)
            except QuadctlError as problem:
                return _refused(peer, kind, problem)
        return Transfer([_ack(peer, mavlink.MAV_MISSION_ACCEPTED, kind)])


def _places(item: Any) -> tuple[int, int]:
    """Return latitude and longitude, 1e-7 degrees; older stations answer with degrees."""
    if item.get_type() == "MISSION_ITEM_INT":
        return item.x, item.y
    return degrees_e7(item.x), degrees_e7(item.y)


def _ack(peer: Peer, result: int, kind: int) -> Any:
    return mavlink.MAVLink_mission_ack_message(*peer, result, kind)


def _refused(peer: Peer, kind: PlanKind, problem: QuadctlError) -> Transfer:
    return Transfer([_ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)], problem.message)


def item_message(peer: Peer, kind: PlanKind, number: int, item: PlanItem) -> Any:
    """Return the message of an item of a plan, with its number."""
    return mavlink.MAVLink_mission_item_int_message(
        *peer, number, item.frame, item.command, 0, 1, *item.params, item.x, item.y, item.z, kind
    )


class PlanUpload:
    """Upload of one plan, by `us` to a vehicle. `result` is empty until it has ended."""

    def __init__(self, kind: PlanKind, items: Sequence[PlanItem], vehicle: Peer, us: Peer) -> None:
        self._kind, self._items, self._vehicle, self._us = kind, items, vehicle, us
        self._sent = mavlink.MAVLink_mission_count_message(*vehicle, len(items), kind)
        self._asked, self._attempts = -AGAIN, 0
        self.result: Literal["", "accepted", "refused", "no answer"] = ""
        self.code = 0
        """MAV_MISSION_RESULT of an upload that was refused."""
        self._asked_for = -1

    def take(self, message: Any, now: float) -> list[Any]:
        """Take a message of the vehicle; return what to send."""
        if self.result or getattr(message, "mission_type", None) != self._kind:
            return []
        if (message.target_system, message.target_component) != self._us:
            return []
        match message.get_type():
            case "MISSION_ACK" if message.type != mavlink.MAV_MISSION_ACCEPTED:
                self.code, self.result = message.type, "refused"
            # An earlier one is the late answer to an upload before.
            case "MISSION_ACK" if self._asked_for == len(self._items) - 1:
                self.result = "accepted"
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST" if message.seq < len(self._items):
                self._asked_for = message.seq
                self._sent = item_message(
                    self._vehicle, self._kind, message.seq, self._items[message.seq]
                )
                self._attempts = 0
                return self._send(now)
        return []

    def tick(self, now: float) -> list[Any]:
        """Return the last message again if no answer came."""
        if self.result or now < self._asked + AGAIN:
            return []
        if self._attempts == ATTEMPTS:
            self.result = "no answer"
            return []
        return self._send(now)

    def _send(self, now: float) -> list[Any]:
        self._asked, self._attempts = now, self._attempts + 1
        return [self._sent]
