"""Record of a flight: the contents of its digests, and the gaps that make it void."""

from typing import Any

import pytest
from msgspec.structs import replace

from quadctl.cli.mission.digest import Record
from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Pressure,
    Quaternion,
    SafetyState,
    Velocity,
)
from quadctl.services.runtime.errors import QuadctlError

END = 0.3
PARAMETERS = {
    "pressure.rate": 10.0,
    "pressure.fault.kind": "none",
    "pressure.fault.delay": 0.1,
}


Change = tuple[float, dict[str, Any]]
"""Time (s) of a change in flight, and the new values of parameters."""


def pose(seq: int, boot: str = "b") -> Pose:
    still = Velocity(0.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 0.0)
    return Pose(boot, seq, seq / 100, Position(seq / 10, 0.0, 1.0), *still)


def state(stamp: float, request: int, reason: str = "", boot: str = "b") -> SafetyState:
    where, cage = Position(0.0, 0.0, 1.0), CageSize(5.0, 5.0, 5.0)
    return SafetyState(boot, stamp, request, "HOVERING", where, True, cage, reason)


def reading(stamp: float, value: float = 1013.0) -> Pressure:
    return Pressure(stamp, value, 0.0, 0, 0.0)


def flight() -> list[Any]:
    """Return the messages of a complete flight, with those published before and after it."""
    before = [pose(77, "a"), reading(1234.0), state(3.0, 8, boot="a")]
    poses = [pose(seq) for seq in range(31)]
    states = [state(0.0, 9, "anew"), state(0.1, 10, "far"), state(0.3, 11, "far")]
    return [*before, *poses, *states, *(reading(stamp) for stamp in (0.0, 0.1, 0.2, 0.3))]


def digests(messages: list[Any], boot: str = "b", *changes: Change) -> dict[str, Any]:
    record = Record(boot, END)
    for message in messages:
        record.add(message)
    record.check(PARAMETERS, changes)
    return record.document()


def test_messages_of_the_flight_are_counted():
    found = digests(flight())
    assert found["counts"] == {"poses": 31, "transitions": 3, "pressure": 4}
    names = ("hash", "poses", "transitions", "pressure")
    assert len({found[name] for name in names}) == 4
    assert all(len(bytes.fromhex(found[name])) == 32 for name in names)


def test_boot_name_and_messages_around_the_flight_do_not_count():
    other = [replace(m, boot="c") if getattr(m, "boot", "") == "b" else m for m in flight()]
    other = [replace(m, request=m.request + 5) if isinstance(m, SafetyState) else m for m in other]
    later = [pose(31, "c"), state(0.35, 99, boot="c"), reading(0.4)]
    assert digests([*other[1:], *later], "c") == digests(flight())


def test_repeated_messages_do_not_count():
    messages = flight()
    again = [m for m in messages for m in (m, m)]
    still_so = [replace(messages[-5], stamp=0.3)]
    assert isinstance(still_so[0], SafetyState)
    assert digests([*again, *still_so]) == digests(messages)


@pytest.mark.parametrize(
    ("number", "field", "value", "log"),
    [
        (10, "velocity", Velocity(0.0, 0.0, 5e-324), "poses"),
        (34, "reason", "", "transitions"),
        (34, "reason", "paused: far", "transitions"),
        (35, "request", 11, "transitions"),
        (35, "goal", Position(0.0, 0.0, 1.0000000000000002), "transitions"),
        (-1, "pressure", 1013.0000000000001, "pressure"),
    ],
)
def test_every_bit_of_other_fields_counts(number: int, field: str, value: Any, log: str):
    messages = flight()
    messages[number] = replace(messages[number], **{field: value})
    found, usual = digests(messages), digests(flight())
    differs = {name for name in ("poses", "transitions", "pressure") if found[name] != usual[name]}
    assert differs == {log}
    assert found["hash"] != usual["hash"]


def test_the_wording_of_a_reason_does_not_count():
    other = [replace(m, reason="so far away") if getattr(m, "reason", "") else m for m in flight()]
    assert other != flight()
    assert digests(other) == digests(flight())


def test_a_state_that_differs_only_in_wording_is_not_counted():
    messages = flight()
    again = replace(messages[-6], reason="farther", stamp=0.2)
    assert isinstance(again, SafetyState)
    assert digests([*messages[:-5], again, *messages[-5:]]) == digests(messages)


def test_a_lost_pose_voids_the_record():
    messages = flight()
    del messages[10]
    with pytest.raises(QuadctlError, match="the poses 7 to 7 were lost"):
        digests(messages)


def test_a_lost_reading_voids_the_record():
    with pytest.raises(QuadctlError, match="3 of 4 barometer readings arrived"):
        digests(flight()[:-1])


@pytest.mark.parametrize(
    ("changes", "stamps"),
    [
        ([(0.0, {"pressure.rate": 5.0})], (0.0, 0.2)),
        ([(0.1, {"pressure.rate": 20.0})], (0.0, 0.1, 0.11, 0.15, 0.2, 0.25, 0.3)),
        ([(0.095, {"pressure.fault.kind": "off"})], (0.0, 0.1)),
        (
            [(0.1, {"pressure.fault.kind": "off"}), (0.2, {"pressure.fault.kind": "none"})],
            (0.0, 0.1, 0.3),
        ),
        (
            [(0, {"pressure.fault.kind": "delay"}), (0.1, {"pressure.fault.delay": 0.3})],
            (0.1, 0.3),
        ),
    ],
)
def test_readings_are_due_by_parameters_set_in_flight(changes: list[Change], stamps: list[float]):
    messages = [m for m in flight() if not isinstance(m, Pressure)]
    messages += [reading(stamp) for stamp in stamps]
    lost = [m for m in messages if getattr(m, "stamp", 0) != stamps[-1] or isinstance(m, Pose)]
    digests(messages, "b", *changes)
    with pytest.raises(QuadctlError, match="incomplete"):
        digests(lost, "b", *changes)


def test_a_reading_after_an_end_between_two_poses_is_not_due():
    record = Record("b", 0.295)
    for message in flight():
        record.add(message)
    record.check(PARAMETERS)
    assert record.document()["counts"] == {"poses": 31, "transitions": 2, "pressure": 3}


def test_a_new_boot_voids_the_record():
    with pytest.raises(QuadctlError, match=r"restarted after 0\.06 s"):
        digests([*flight()[:10], pose(0, "c")])


def test_a_missing_end_voids_the_record():
    record = Record("b", END)
    record.add(pose(0))
    record.add(reading(0.0))
    with pytest.raises(QuadctlError, match="incomplete"):
        record.check(PARAMETERS)
