"""Calls on an open connection: typed, on bare Zenoh and in rospy, block by block in turn."""

from benchmarks import ros
from benchmarks.effort import Effort
from benchmarks.ends import ends
from benchmarks.results import Results

_WARM, _BLOCK = 50, 200
_REQUEST_BYTES = 9
"""`{"cage_on": true}` in MessagePack."""


def measure(results: Results, effort: Effort) -> None:
    """Measure each run with fresh processes, because their places on the cores shift all values.

    The same code has ratios from 0.8 to 1.4, run by run: the runs are many and short.
    """
    if why := ros.absent():
        results.missing(["call", "call_persistent"], "ros", why)
    for run in range(effort.call_runs):
        with ends("call", "serve", 1, _REQUEST_BYTES) as sides:
            for end in sides.values():
                end.sender.ask("call", count=_WARM)
            for side, end in sides.items():
                times = end.sender.ask("call", count=_BLOCK)
                results.seconds("call", side, times, run)
                if side == "ros":
                    times = end.sender.ask("call_persistent", count=_BLOCK)
                results.seconds("call_persistent", side, times, run)
