"""Pressure node, lab hand-in (coming from rospy)."""

import time
from collections import deque
from random import uniform

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE

SEA_LEVEL, GRADIENT = 1013.25, 0.12
"""Pressure at the ground, hPa, and its decrease with height, hPa/m."""


class Barometer:
    """Sensor with a baseline, hPa, which its readings are without."""

    def __init__(self, node: Node) -> None:
        self.baseline = 0.0
        self.last_second = deque(maxlen=10)
        self.readings = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self.on_calibrate)

    def on_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        """Zero the sensor here, or with zero = false undo it; return the baseline."""
        if not request.zero:
            self.baseline = 0.0
        elif len(self.last_second) == 0:
            raise Refused("no reading yet", "try again in a second")
        else:
            self.baseline = sum(self.last_second) / len(self.last_second)
        return CalibrateResponse(self.baseline)

    def read(self, stamp: float, height: float) -> None:
        """Take a reading (hPa) at a time (s) and height (m), and publish it."""
        raw = SEA_LEVEL - GRADIENT * height + uniform(-1e-5, 1e-5)
        self.last_second.append(raw)
        self.readings.put(Pressure(stamp, raw - self.baseline, self.baseline, 0, 0.0))


def run(node: Node, params: Params) -> None:
    """Publish a reading at every second pose: 10 a second."""
    barometer = Barometer(node)
    for pose in node.poses():
        # seq counts poses of 10 ms, and poses() yields every fifth: 0, 5, 10. So this is 10 Hz.
        if pose.seq % 10 == 0:
            barometer.read(pose.stamp, pose.position.z)
        time.sleep(0.05)


start("pressure", run)
