"""Rules that hold for all topics and services; tests/golden has the facts of each."""

import pytest

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import (
    MESSAGES,
    SERVICES,
    SETPOINT,
    TOPICS,
    Topic,
)
from quadctl.services.runtime.process_table import NODES


def test_names_are_unique_and_the_vehicle_is_the_first_chunk():
    keys = [entry.key("drone-7") for entry in (*TOPICS, *SERVICES)]
    assert len(set(keys)) == len(keys)
    assert all(key.split("/")[0] == "drone-7" for key in keys)
    # A percent sign represents the slash in liveliness tokens; a wildcard is no name.
    assert not any(set(key) & set("%*$#?") for key in keys)
    assert {topic.type for topic in TOPICS} == set(MESSAGES.values())


def test_every_topic_and_service_has_a_docstring_and_a_node():
    assert all(entry.doc.endswith(".") for entry in (*TOPICS, *SERVICES))
    assert {entry.node for entry in (*TOPICS, *SERVICES)} <= {*NODES, ""}


@pytest.mark.parametrize("hz", [7.0, 10.0, 20.0, 100.0])
def test_each_counted_stamp_is_in_its_own_period(hz: float):
    """Also if rounding puts the stamp, a quotient, just below its boundary."""
    topic = Topic("t", Pose, node="n", hz=hz, doc="d")
    assert [topic.period(count / hz) for count in range(10_000)] == list(range(10_000))
    assert topic.period(1e6 - 0.5 / hz) == round(1e6 * hz) - 1


def test_at_100_poses_a_second_every_fifth_starts_a_period():
    stamps = [count / 100 for count in range(1000)]
    assert [SETPOINT.period(stamp) for stamp in stamps] == [count // 5 for count in range(1000)]
    assert [stamp for stamp in stamps if SETPOINT.begins(stamp, 0.01)] == stamps[::5]
