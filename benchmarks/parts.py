"""Parts of a run, each a function and the rows that it measures."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks import (
    bridges,
    calls,
    commands,
    flights,
    footprint,
    hover,
    lab,
    launches,
    lockstep,
    many,
    page,
    recorder,
    recordings,
    topics,
)  # fmt: skip
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.rows import ROWS


@dataclass(frozen=True)
class Part:
    """Rows that are measured together, and fail together."""

    group: str
    keys: tuple[str, ...]
    measure: Callable[[Results, Effort], None]


def _whole(group: str, measure: Callable[[Results, Effort], None]) -> Part:
    return Part(group, tuple(row.key for row in ROWS if row.group == group), measure)


PARTS = (
    _whole("commands", commands.measure),
    _whole("calls", calls.measure),
    Part("topics", ("topic_100", "topic_1000"), topics.measure_one),
    Part("topics", ("throughput", "throughput_lost", "steady_lost"), topics.measure_throughput),
    Part("topics", ("topic_fan",), topics.measure_fan),
    Part("launches", ("launch", "interrupt", "orphan"), launches.measure),
    Part("launches", ("leftovers",), launches.measure_leftovers),
    Part("footprint", ("hover_processor", "system_memory"), hover.measure),
    Part("footprint", ("flight_processor", "node_memory"), footprint.measure_flight),
    Part("footprint", ("lone_memory",), footprint.measure_nodes),
    Part("footprint", ("gone",), footprint.measure_gone),
    _whole("vehicles", many.measure),
    _whole("flights", flights.measure),
    _whole("lockstep", lockstep.measure),
    _whole("recorder", recorder.measure),
    _whole("recordings", recordings.measure),
    _whole("console", page.measure),
    Part("bridges", ("ros2_processor", "ros2_memory", "ros2_age"), bridges.measure_ros2),
    Part(
        "bridges",
        ("foxglove_processor", "foxglove_memory", "foxglove_age"),
        bridges.measure_foxglove,
    ),
    Part("bridges", ("mavlink_processor", "mavlink_memory"), bridges.measure_mavlink),
    Part("bridges", ("autopilot_processor", "autopilot_memory"), bridges.measure_autopilot),
    Part("lab", ("grade_30",), lab.measure_class),
    Part("lab", ("import",), lab.measure_import),
)  # fmt: skip
