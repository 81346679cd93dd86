"""Pressure node with a loop of 20 Hz: it publishes at every second tick."""

from collections import deque
from random import uniform

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE_SLOW, PRESSURE

SEA_LEVEL = 1013.25  # hPa
GRADIENT = 0.12  # hPa/m


class PressureNode:
    def __init__(self, node: Node) -> None:
        self.node = node
        self.newest: Pose | None = None
        self.baseline = 0.0
        self.window: deque[tuple[float, float]] = deque()  # (stamp, raw reading)
        self.pub = node.publisher(PRESSURE)
        node.listen(POSE_SLOW, self.pose_callback)
        node.serve(CALIBRATE, self.calibrate_callback)

    def pose_callback(self, pose: Pose) -> None:
        if self.newest is not None and pose.boot != self.newest.boot:
            self.window.clear()
        self.newest = pose
        self.node.advance_sim_time(pose.boot, pose.stamp)

    def sample(self, pose: Pose) -> float:
        """Take a reading, hPa, and drop those older than a second."""
        raw = SEA_LEVEL - GRADIENT * pose.position.z + uniform(-1e-5, 1e-5)
        self.window.append((pose.stamp, raw))
        self.drop_old(pose.stamp)
        return raw

    def drop_old(self, now: float) -> None:
        while self.window and self.window[0][0] <= now - 1.0 + 1e-6:
            self.window.popleft()

    def calibrate_callback(self, request: CalibrateRequest) -> CalibrateResponse:
        if not request.zero:
            self.baseline = 0.0
            return CalibrateResponse(self.baseline)
        if self.newest is None:
            raise Refused("no pose has come yet", "call again")
        self.drop_old(self.newest.stamp)
        if not self.window:  # the simulation is much faster than our ticks
            self.sample(self.newest)
        values = [raw for _, raw in self.window]
        self.baseline = sum(values) / len(values)
        return CalibrateResponse(self.baseline)

    def publish(self) -> None:
        if self.newest is not None:
            raw = self.sample(self.newest)
            self.pub.put(
                Pressure(self.newest.stamp, raw - self.baseline, self.baseline, 0, 0.0)
            )


def run(node: Node, params: Params) -> None:
    pressure = PressureNode(node)
    count = 0
    for _ in node.ticks(20):
        if count % 2 == 0:
            pressure.publish()
        count += 1


start("pressure", run)
