"""Upload of a plan to a vehicle: the other side of `transfers`. Pure."""

from collections.abc import Sequence
from typing import Any, Literal

from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.bridges.mavlink.plan import PlanItem
from quadctl.services.bridges.mavlink.transfers import AGAIN, ATTEMPTS, Peer, PlanKind, item_message


class PlanUpload:
    """Upload of one plan, by `us` to a vehicle. `result` is empty until it has ended."""

    def __init__(self, kind: PlanKind, items: Sequence[PlanItem], vehicle: Peer, us: Peer) -> None:
        self._kind, self._items, self._vehicle, self._us = kind, items, vehicle, us
        self._sent, self._asked, self._attempts = self._count(), -AGAIN, 0
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

    def _count(self) -> Any:
        return mavlink.MAVLink_mission_count_message(*self._vehicle, len(self._items), self._kind)
