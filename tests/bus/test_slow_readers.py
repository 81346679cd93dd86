"""Beside a viewer of everything that stands still, safety answers every pose that is due, as soon as ever."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest
import zenoh

from tests.support.bare import Bare, unpack
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually

SIZE = 8_000_000


def test_a_query_of_megabytes_comes_through_whole_and_back():
    def echo(query: zenoh.Query) -> None:
        with query:
            assert query.payload is not None
            query.reply("stranger/echo", query.payload.to_bytes())

    sent = bytes(range(256)) * (SIZE // 256)
    # A lab of its own: were the hub to stop over it, all others of its tests would suffer.
    with private_lab() as lab:
        lab.start("--set", "dynamics.start.z=1")
        with lab.bare() as server, lab.bare() as caller, lab.bare() as third:
            server.session.declare_queryable("stranger/echo", echo, complete=True)
            poses = third.watch("uav/pose")
            assert asked(caller, sent) == [sent]
            stamps = [pose["stamp"] for pose in poses.next(20)]
            assert stamps == sorted(stamps)
            assert lab.nodes()["hub"]["restarts"] == 0


def asked(caller: Bare, sent: bytes) -> list[bytes]:
    replies = caller.session.get("stranger/echo", payload=sent, timeout=20.0)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


PERIOD = 5
"""Poses between two answers."""


class Answers:
    """When each pose came, and its answer, by its number; monotonic s."""

    def __init__(self, bare: Bare) -> None:
        self._asked: dict[int, float] = {}
        self._told: dict[int, float] = {}
        self._subscribers = [
            bare.session.declare_subscriber("uav/pose", self._on_pose),
            bare.session.declare_subscriber("uav/input/position", self._on_setpoint),
        ]

    def _on_pose(self, sample: zenoh.Sample) -> None:
        self._asked.setdefault(unpack(sample.payload.to_bytes())["seq"], time.monotonic())

    def _on_setpoint(self, sample: zenoh.Sample) -> None:
        self._told.setdefault(unpack(sample.payload.to_bytes())["for_seq"], time.monotonic())

    @property
    def answered(self) -> list[int]:
        """The poses that have an answer."""
        return sorted(self._told)

    @property
    def latencies(self) -> list[float]:
        """From a pose to its answer, s, the shortest first."""
        return sorted(
            told - self._asked[seq] for seq, told in self._told.items() if seq in self._asked
        )


@pytest.fixture(scope="module")
def watched() -> Iterator[Lab]:
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1", *PATIENT)
        yield made


@contextmanager
def standing_still(lab: Lab) -> Iterator[None]:
    """A viewer of all keys, stopped when it has seen something."""
    viewer = lab.spawn(*lab.command("topic", "echo", "uav/**"))
    eventually(lambda: viewer.log)
    os.kill(viewer.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        viewer.end()


def flown(lab: Lab, legs: int) -> Answers:
    """What was answered in some flights to and fro."""
    with lab.bare() as bare:
        answers = Answers(bare)
        for leg in range(legs):
            bare.fly(3.0 if leg % 2 else -3.0, 0.0, 1.0)
        return answers


def test_no_answer_to_a_pose_is_missed_beside_a_stalled_viewer(watched: Lab):
    with standing_still(watched):
        answered = flown(watched, 4).answered
    steps = [b - a for a, b in pairwise(answered)]
    assert len(steps) > 50
    assert set(steps) <= set(range(1, 2 * PERIOD + 1)), "a period was left out"


@pytest.mark.prove
@pytest.mark.timeout(300)
def test_and_it_comes_as_soon(watched: Lab, proofs: Proofs):
    free: list[float] = []
    beside: list[float] = []
    for _ in range(5):
        free += flown(watched, 3).latencies
        with standing_still(watched):
            beside += flown(watched, 3).latencies
    (median, late), (median_beside, late_beside) = map(middle_and_tail, (free, beside))
    proofs.add(
        "a viewer of all keys that stands still: from a pose to safety's answer",
        f"{median_beside:.1f} ms, p99 {late_beside:.1f} ms (n {len(beside)});"
        f" without it {median:.1f} ms, p99 {late:.1f} ms",
        "median within 1.2 times and 0.2 ms",
    )
    assert median_beside <= 1.2 * median + 0.2


def middle_and_tail(times: list[float]) -> tuple[float, float]:
    """The median and the 99th percentile, ms."""
    times = sorted(times)
    return 1000 * times[len(times) // 2], 1000 * times[99 * len(times) // 100]
