"""Time and memory that commands need for the recording of an hour."""

import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from math import cos, sin
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from benchmarks.children import PYTHON, TOP, Failed
from benchmarks.effort import Effort
from benchmarks.ours.node import pose
from benchmarks.results import Results
from benchmarks.system import QUADCTL, home
from quadctl.schemas.messages import CageSize, Pose, Position, Pressure, SafetyState, Setpoint
from quadctl.schemas.topics import POSE, POSE_SLOW, PRESSURE, SETPOINT, STATE, Topic
from quadctl.services.recorder.recording import Recording
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.streams import RawMessage

_HOUR = 3600
_POSES_PER_SECOND, _POSES_PER_FLUSH = 100, 25
_NEW_GOAL = 10.0
_BEGAN = 1_800_000_000 * 10**9
_CAGE = CageSize(5.0, 5.0, 2.0)


def measure(results: Results, effort: Effort) -> None:
    """Measure `plot` and `bag check`, each in a process of its own."""
    with home() as where:
        file = where.folder / "hour.mcap"
        _record(file)
        plot = ("plot", str(file), "-o", str(where.folder / "hour.png"), "--force")
        for run in range(effort.runs):
            seconds, memory = _used(plot, where.environment)
            results.add("plot_hour", "ours", [seconds], run)
            results.add("plot_memory", "ours", [memory], run)
            seconds, _ = _used(("bag", "check", str(file)), where.environment)
            results.add("check_hour", "ours", [seconds], run)


def _record(file: Path) -> None:
    """Write the recording of an hour with all topics at their rates, as the recorder does."""
    recording = Recording(file, {"vehicle": "uav"})
    for number in range(_HOUR * _POSES_PER_SECOND):
        recording.take(_messages(number))
        if number % _POSES_PER_FLUSH == 0:
            recording.flush()
    recording.end()


def _messages(number: int) -> Iterator[RawMessage]:
    stamp = number / _POSES_PER_SECOND
    legs = int(stamp / _NEW_GOAL)
    goal, pose_now = Position(4 * sin(legs), 4 * cos(2 * legs), 1.0), _pose(number, stamp)
    for topic, message in (
        (POSE, pose_now),
        (POSE_SLOW, pose_now),
        (SETPOINT, Setpoint("b0", number, goal, brake=False)),
        (PRESSURE, Pressure(stamp, -0.1 + 0.001 * sin(stamp), 1013.2, 10, 1e-5)),
        (STATE, SafetyState("b0", stamp, legs, "MOVING", goal, True, _CAGE, "")),
    ):
        if number % round(_POSES_PER_SECOND / topic.hz) == 0:
            yield _received(topic, message, stamp)


def _pose(number: int, stamp: float) -> Pose:
    full = pose(number)
    place = Position(4 * sin(stamp / 9), 4 * cos(stamp / 7), 1 + 0.5 * sin(stamp / 5))
    return replace(full, boot="b0", stamp=stamp, position=place)


def _received(topic: Topic[Any], message: Struct, stamp: float) -> RawMessage:
    at = _BEGAN + round(stamp * 1e9)
    encoding = codec.encoding(type(message))
    return RawMessage(topic.key("uav"), codec.encode(message), encoding, at, at - 1000)


def _used(words: tuple[str, ...], environment: dict[str, str]) -> tuple[float, float]:
    """Return the time (s) and the most memory (MB, resident) of a command; raise Failed.

    A small process starts the command: a child's maximum includes the memory of its parent, and
    that of the benchmarks is large.
    """
    starter = [*PYTHON, "benchmarks.recordings", QUADCTL, *words]
    done = subprocess.run(
        starter, env=environment | TOP, stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise Failed(f"quadctl {words[0]}: exit {done.returncode}")
    seconds, memory = map(float, done.stdout.split())
    return seconds, memory


def _use(command: list[str]) -> int:
    """Run a command; print its time (s) and the most memory (MB, resident); return its exit code."""
    began = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    seconds = time.perf_counter() - began
    print(seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1000)
    return done.returncode


if __name__ == "__main__":
    sys.exit(_use(sys.argv[1:]))
