"""Transfers of missions and fences, with messages that are lost, repeated and mixed up."""

import math
import random
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, strategies as st
from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.bridges.mavlink.plan import MOST_ITEMS, NOWHERE, PlanItem
from quadctl.services.bridges.mavlink.transfers import AGAIN, ATTEMPTS, PlanKind, Transfers
from quadctl.services.runtime.errors import Refused

ME, OTHER = 255, 254


class Shelf:
    """Store that refuses the fences of more than `most` items."""

    def __init__(self, most: int = 1000) -> None:
        self.plans: dict[PlanKind, Sequence[PlanItem]] = {}
        self.most = most

    def load(self, kind: PlanKind) -> Sequence[PlanItem]:
        return self.plans.get(kind, [])

    def save(self, kind: PlanKind, items: Sequence[PlanItem]) -> None:
        if len(items) > self.most:
            raise Refused("too many")
        self.plans[kind] = list(items)


def of(message: Any, peer: int = ME) -> Any:
    """Return a message of a peer, as it comes from the wire."""
    packet = message.pack(mavlink.MAVLink(None, peer, 190))
    return mavlink.MAVLink(None).decode(bytearray(packet))


def count(number: int, kind: int = 0) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, number, kind)


def item(seq: int, kind: int = 0) -> Any:
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, 6, 16, 0, 1, 0, 0, 0, 0, seq, 0, 1, kind
    )


def result_of(transfer: Any) -> int:
    (message,) = transfer.messages
    assert message.get_type() == "MISSION_ACK"
    result: int = message.type
    return result


@given(st.integers(1, 12), st.randoms(use_true_random=False), st.sampled_from([0, 1]))
def test_an_upload_arrives_whole_through_loss_and_repetition(
    items: int, chance: random.Random, kind: int
):
    shelf = Shelf()
    transfers, now = Transfers(shelf), 0.0
    replies = list(transfers.take(of(count(items, kind)), now).messages)
    for _ in range(2000):
        if PlanKind(kind) in shelf.plans:
            break
        now += 0.1
        replies += transfers.tick(now).messages
        while replies:
            asked = replies.pop(0)
            # Few are lost in a row, so the upload is not given up.
            if asked.get_type() == "MISSION_REQUEST_INT" and chance.random() < 0.6:
                for _ in range(chance.randrange(1, 3)):
                    replies += transfers.take(of(item(asked.seq, kind)), now).messages
    assert [each.x for each in shelf.plans.get(PlanKind(kind), [])] in ([*range(items)], [])


@pytest.mark.parametrize(
    ("x", "y", "place"),
    [
        (47.5, -8.25, (475_000_000, -82_500_000)),
        (math.nan, math.nan, (NOWHERE, NOWHERE)),
        (1e9, 0.0, (NOWHERE, 0)),
    ],
)
def test_an_older_station_answers_with_degrees(x: float, y: float, place: tuple[int, int]):
    shelf = Shelf()
    transfers = Transfers(shelf)
    transfers.take(of(count(1)), 0)
    old = mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, x, y, 1, 0)
    assert result_of(transfers.take(of(old), 0)) == mavlink.MAV_MISSION_ACCEPTED
    (found,) = shelf.plans[PlanKind.MISSION]
    assert (found.x, found.y, found.frame, found.command) == (*place, 3, 16)


def test_an_upload_that_nobody_continues_is_given_up():
    transfers, now, asked = Transfers(Shelf()), 0.0, 1
    assert transfers.take(of(count(2)), now).messages
    while True:
        now += AGAIN
        reply = transfers.tick(now)
        if reply.messages[0].get_type() == "MISSION_ACK":
            break
        asked += 1
    assert asked == ATTEMPTS
    assert result_of(reply) == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert not transfers.uploading
    assert not transfers.take(of(item(0)), now).messages


def test_a_second_station_waits_for_the_first():
    transfers = Transfers(Shelf())
    transfers.take(of(count(2)), 0)
    assert result_of(transfers.take(of(count(2), OTHER), 0)) == mavlink.MAV_MISSION_DENIED
    assert not transfers.take(of(item(0), OTHER), 0).messages
    # The first one begins anew.
    assert transfers.take(of(count(1)), 0).messages[0].seq == 0
    assert result_of(transfers.take(of(item(0)), 0)) == mavlink.MAV_MISSION_ACCEPTED


def test_a_station_may_give_up_its_upload():
    transfers = Transfers(Shelf())
    transfers.take(of(count(2)), 0)
    cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
    transfers.take(of(mavlink.MAVLink_mission_ack_message(1, 1, cancelled, 0), OTHER), 0)
    assert transfers.uploading
    transfers.take(of(mavlink.MAVLink_mission_ack_message(1, 1, cancelled, 0)), 0)
    assert not transfers.uploading


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (count(MOST_ITEMS + 1), mavlink.MAV_MISSION_NO_SPACE),
        (count(1, 2), mavlink.MAV_MISSION_UNSUPPORTED),
        (count(1, 7), mavlink.MAV_MISSION_UNSUPPORTED),
        (count(0, 2), mavlink.MAV_MISSION_ACCEPTED),
        (mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0), 13),
        (mavlink.MAVLink_mission_clear_all_message(1, 1, 255), mavlink.MAV_MISSION_ACCEPTED),
    ],
)
def test_other_requests_are_answered(message: Any, result: int):
    assert result_of(Transfers(Shelf()).take(of(message), 0)) == result


def test_a_refused_plan_leaves_the_old_one():
    shelf = Shelf(most=1)
    transfers = Transfers(shelf)
    transfers.take(of(count(1)), 0)
    transfers.take(of(item(0)), 0)
    transfers.take(of(count(2)), 0)
    transfers.take(of(item(0)), 0)
    refused = transfers.take(of(item(1)), 0)
    assert (result_of(refused), refused.reason) == (mavlink.MAV_MISSION_UNSUPPORTED, "too many")
    assert len(shelf.plans[PlanKind.MISSION]) == 1
