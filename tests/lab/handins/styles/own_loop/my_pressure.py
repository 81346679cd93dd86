"""Pressure node with its own queue of poses, and numpy for the statistics."""

from collections import deque

import numpy as np

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE_SLOW, PRESSURE

RNG = np.random.default_rng()


class Barometer:
    def __init__(self, node: Node):
        self.window: deque[float] = deque(maxlen=10)
        self.baseline, self.samples, self.spread = 0.0, 0, 0.0
        self.last = ("", -1)
        self.readings = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self.on_calibrate)

    def on_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        if not request.zero:
            self.baseline, self.samples, self.spread = 0.0, 0, 0.0
            return CalibrateResponse(0.0)
        if not self.window:
            raise Refused("no reading yet", "wait a moment")
        raw = np.array(self.window)
        self.baseline = float(raw.mean())
        self.samples = len(self.window)
        self.spread = float(np.ptp(raw))
        return CalibrateResponse(self.baseline)

    def on_pose(self, pose: Pose):
        boot, number = self.last
        if pose.boot != boot:
            self.window.clear()
        elif PRESSURE.period(pose.stamp) == number:
            return  # this tenth of a second has its reading
        self.last = (pose.boot, PRESSURE.period(pose.stamp))
        raw = 1013.25 - 0.12 * pose.position.z + float(RNG.uniform(-1e-5, 1e-5))
        self.window.append(raw)
        self.readings.put(
            Pressure(pose.stamp, raw - self.baseline, self.baseline, self.samples, self.spread)
        )


def run(node: Node, params: Params) -> None:
    barometer = Barometer(node)
    queue: deque[Pose] = deque()
    node.listen(POSE_SLOW, queue.append)
    node.ready()
    while not node.stopping:
        node.wait_for(lambda: bool(queue), 0.1)
        while queue:
            pose = queue.popleft()
            node.advance_sim_time(pose.boot, pose.stamp)
            barometer.on_pose(pose)


start("pressure", run)
