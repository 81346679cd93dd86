"""Barometer with a sensor thread: it takes readings, the main thread serves."""

import threading
import time
from random import uniform

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE, PRESSURE


class Barometer:
    def __init__(self, node: Node) -> None:
        self.lock = threading.Lock()
        self.pose = None
        self.baseline = 0.0
        self.boot = ""
        self.tenth = -1  # tenth of a second of the last reading
        self.history = []  # (stamp, hPa)
        self.pub = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self.on_calibrate)
        node.listen(POSE, self.on_pose)
        threading.Thread(target=self.sensor_loop, daemon=True).start()

    def on_pose(self, pose: Pose) -> None:
        with self.lock:
            self.pose = pose

    def on_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        with self.lock:
            if not request.zero:
                self.baseline = 0.0
            elif not self.history:
                raise Refused("no readings yet", "wait a second")
            else:
                self.baseline = sum(raw for _, raw in self.history) / len(self.history)
            return CalibrateResponse(self.baseline)

    def sensor_loop(self) -> None:
        while True:
            with self.lock:
                if self.pose is not None:
                    self.read(self.pose)
            time.sleep(0.02)

    def read(self, pose: Pose) -> None:
        if pose.boot != self.boot:
            self.boot, self.tenth, self.history = pose.boot, -1, []
        tenth = int(pose.stamp * 10 + 1e-6)
        if tenth == self.tenth:
            return
        self.tenth = tenth
        raw = 1013.25 - 0.12 * pose.position.z + uniform(-1e-5, 1e-5)
        self.history.append((pose.stamp, raw))
        self.history = [(t, r) for t, r in self.history if t > pose.stamp - 0.999]
        self.pub.put(Pressure(pose.stamp, raw - self.baseline, self.baseline, 0, 0.0))


def run(node: Node, params: Params) -> None:
    Barometer(node)
    node.spin()


start("pressure", run)
