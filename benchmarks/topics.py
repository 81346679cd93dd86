"""One-way times from a publisher to a handler: typed, on bare Zenoh and in rospy, in turn."""

import time
from collections.abc import Iterable

from benchmarks import ros
from benchmarks.bars import Side
from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.ends import Ends, ends
from benchmarks.ours.node import pose
from benchmarks.results import Results
from quadctl.services.runtime.bus import codec

_POSE_BYTES = len(codec.encode(pose(1000)))
_FLOOD_SECONDS = 2.0
_STEADY = 0.2
"""Share of the hand-written subscriber's throughput that is sent to both without a loss."""
_FAN = 8
_CONNECTED_WITHIN = 10.0


def measure_one(results: Results, effort: Effort) -> None:
    """Measure 1 to 1, at two rates."""
    _absent(results, ["topic_100", "topic_1000"])
    for run in range(effort.topic_runs):
        with ends("publish", "listen", 1, _POSE_BYTES) as sides:
            _settle(sides.values())
            for _ in range(effort.blocks):
                for key, hz, count in (("topic_100", 100, 100), ("topic_1000", 1000, 1000)):
                    for side, end in sides.items():
                        results.seconds(key, side, _ages(end, count, hz), run)


def measure_throughput(results: Results, effort: Effort) -> None:
    """Measure 1 to 1 without pause, beside what a person writes by hand on bare Zenoh and msgspec."""
    _absent(results, ["throughput", "throughput_lost", "steady_lost"])
    for run in range(effort.topic_runs):
        with ends("publish", "listen", 1, _POSE_BYTES, by_hand=True) as sides:
            _settle(sides.values())
            rates: dict[Side, float] = {}
            for side, end in sides.items():
                sent = end.sender.ask("flood", seconds=_FLOOD_SECONDS)
                received, rates[side] = end.receivers[0].ask("rate")
                results.add("throughput", side, [rates[side]], run)
                results.add("throughput_lost", side, [100 * (1 - received / sent)], run)
            steady = _STEADY * rates["raw"]
            count = round(steady * _FLOOD_SECONDS)
            for side, end in sides.items():
                end.sender.ask("publish", count=count, hz=steady)
                received, _ = end.receivers[0].ask("rate")
                results.add("steady_lost", side, [100 * (1 - received / count)], run)


def measure_fan(results: Results, effort: Effort) -> None:
    """Measure 1 to 8."""
    _absent(results, ["topic_fan"])
    for run in range(effort.topic_runs):
        with ends("publish", "listen", _FAN, _POSE_BYTES) as sides:
            _settle(sides.values())
            for _ in range(effort.blocks):
                for side, end in sides.items():
                    results.seconds("topic_fan", side, _ages(end, 1000, 1000), run)


def _absent(results: Results, keys: list[str]) -> None:
    if why := ros.absent():
        results.missing(keys, "ros", why)


def _settle(sides: Iterable[Ends]) -> None:
    """Wait until every subscriber receives messages; raise Failed if one does not."""
    for end in sides:
        deadline = time.monotonic() + _CONNECTED_WITHIN
        while not _heard_by_all(end):
            if time.monotonic() > deadline:
                raise Failed("a subscriber receives no message of its publisher")
        _ages(end, 100, 1000)


def _ages(end: Ends, count: int, hz: float) -> list[float]:
    """Return the ages (s) of `count` messages at all receivers together."""
    end.sender.ask("publish", count=count, hz=hz)
    for receiver in end.receivers:
        receiver.tell("take", count=count)
    return [age for receiver in end.receivers for age in receiver.answer()]


def _heard_by_all(end: Ends) -> bool:
    end.sender.ask("publish", count=1, hz=1)
    heard = [receiver.ask("take", count=1, within=0.2) for receiver in end.receivers]
    return all(heard)
