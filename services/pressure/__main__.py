"""The barometer's process: `sensors/pressure` and `calibrate_pressure`."""

import math
import time

from schemas.messages import Pose
from schemas.params import Params
from schemas.topics import POSE, period
from services.pressure.process.output import Output
from services.runtime.entry import start
from services.runtime.node import Node
from services.runtime.params.load import launch_lines

_DEPTH = 100_000
"""Poses that may wait: in lock-step nobody waits for the sensor, and none must be lost to it."""
_FIRST_POSE = 1.0
"""How long (s) readiness waits for a first pose, so that who sees us ready can calibrate."""


class Rhythm:
    """When a reading is taken: in real time at a rate of its own, in lock-step by the poses'."""

    def __init__(self, node: Node, params: Params) -> None:
        self._node, self._params = node, params
        self._by_poses = False
        self._output = Output(node, params, self._now)
        self._boot, self._last = "", -1
        self._poses = node.listen(POSE, self._on_pose, _DEPTH)
        if self._in_real_time:
            # The poses that come between two readings need wake nobody.
            self._poses.rest(math.inf)
        self._output.tell_fault()

    def run(self) -> None:
        """Read until stopped."""
        self._node.wait_for(lambda: self._poses.value is not None, _FIRST_POSE)
        for now in self._node.ticks(lambda: self._params.pressure.rate):
            if self._in_real_time:
                self._by_poses = False
                self._output.read(now, self._poses.value)

    @property
    def _in_real_time(self) -> bool:
        return self._params.dynamics.speed == 1 and not self._node.in_mission

    def _now(self) -> float:
        """The time of the clock that the last reading was taken by, s."""
        pose = self._poses.value
        return pose.stamp if self._by_poses and pose else time.monotonic()

    def _on_pose(self, pose: Pose) -> None:
        if pose.boot != self._boot:
            self._boot, self._last = pose.boot, -1
            self._node.clock(pose.boot, 0.0)
            if not self._in_real_time:
                # Equal flights read alike.
                self._output.begin()
        now = period(pose.stamp, self._params.pressure.rate)
        if now != self._last and not self._in_real_time:
            self._last, self._by_poses = now, True
            self._output.read(pose.stamp, pose)
        self._node.clock(pose.boot, pose.stamp)


def run(node: Node, params: Params) -> None:
    """Publish readings: at the vehicle's height from the first pose on, or of a real sensor."""
    for line in launch_lines(params.pressure, node.like and node.like.pressure):
        node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the baseline is 0 again")
    Rhythm(node, params).run()


if __name__ == "__main__":
    start("pressure", run)
