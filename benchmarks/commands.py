"""Whole commands, from the shell's fork to the exit: ours, bare Zenoh's and ROS's in turn."""

import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from benchmarks import ros
from benchmarks.bars import Side
from benchmarks.children import Failed, process
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, running

_RAW = Path(__file__).with_name("raw") / "command.py"
_LONGEST = 30.0


@dataclass(frozen=True)
class Command:
    """Row with the command line of each side for the same task; for bare Zenoh a verb and a key."""

    key: str
    ours: str
    raw: tuple[str, str] | None
    ros: tuple[str, ...]


COMMANDS = (
    Command("call_command", "service call toggle_cage cage_on=true",
            ("get", "uav/@srv/toggle_cage"), ("rosservice", "call", "/toggle_cage", "true")),
    Command("topic_list", "topic list", ("list", "uav/@node/*/@pub/**"), ("rostopic", "list")),
    Command("service_list", "service list", ("list", "uav/@node/*/@srv/**"),
            ("rosservice", "list")),
    Command("node_list", "node list", ("list", "uav/@node/*"), ("rosnode", "list")),
    Command("topic_echo", "topic echo sensors/pressure -n 1", ("echo", "uav/sensors/pressure"),
            ("rostopic", "echo", "-n", "1", "/uav/sensors/pressure")),
    Command("type_show", "type show toggle_cage", None,
            ("rossrv", "show", "quadctl_bench/toggle_cage")),
    Command("param_get", "param get safety.acceptance_range", None,
            ("rosparam", "get", "/lab/acceptance_range")),
    Command("topic_pub", "topic pub input/position_request x=1 y=1 z=1",
            ("put", "uav/input/position_request"),
            ("rostopic", "pub", "-1", "/uav/input/position_request", "geometry_msgs/Vector3",
             "{x: 1, y: 1, z: 1}")),
)  # fmt: skip


def measure(results: Results, effort: Effort) -> None:
    """Measure all commands in turn, many times, so that noise affects all of them alike."""
    keys = [command.key for command in COMMANDS]
    with ExitStack() as stack:
        home = stack.enter_context(running())
        graph = None
        if why := ros.absent():
            results.missing(keys, "ros", why)
        else:
            graph = stack.enter_context(ros.master(home.folder / "ros"))
            stack.enter_context(process(graph.lab(), graph.environment))
            graph.wait(["rosservice", "list"], "/toggle_cage")
        every = max(effort.commands // effort.ros_commands, 1)
        # The first round warms up caches and bytecode, and is not counted.
        for number in range(effort.commands + 1):
            for command in COMMANDS:
                _once(results, command, home, None if number % every else graph, number > 0)


def _once(
    results: Results, command: Command, home: Home, graph: ros.Ros | None, counts: bool
) -> None:
    if results.failed(command.key):
        return
    sides: list[tuple[Side, Sequence[str], Mapping[str, str]]] = [
        ("ours", [QUADCTL, *command.ours.split()], home.environment)
    ]
    if command.raw is not None:
        asked = [sys.executable, str(_RAW), home.endpoint, *command.raw]
        sides.append(("raw", asked, home.raw))
    if graph is not None:
        sides.append(("ros", command.ros, graph.environment))
    for side, words, environment in sides:
        try:
            taken = whole(words, environment)
        except Failed as error:
            results.fail([command.key], f"{side}: {error}")
            return
        if counts:
            results.seconds(command.key, side, [taken])


def whole(words: Sequence[str], environment: Mapping[str, str]) -> float:
    """Return the time (s) of a command until its end, its output read; raise Failed if it fails."""
    began = time.perf_counter()
    try:
        done = subprocess.run(
            words, env=environment, stdin=subprocess.DEVNULL, capture_output=True,
            text=True, timeout=_LONGEST, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise Failed(f"{' '.join(words)}: not done in {_LONGEST:g} s") from error
    taken = time.perf_counter() - began
    if done.returncode:
        raise Failed(f"{' '.join(words)}: exit {done.returncode}: {done.stderr.strip()[-300:]}")
    return taken
