"""Pressure node: ten readings a second; a service zeroes them."""

from collections import deque
from random import uniform
from statistics import fmean

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE

SEA_LEVEL, GRADIENT = 1013.25, 0.12


class Barometer:
    def __init__(self, node: Node) -> None:
        self.baseline = 0.0
        self.window: deque[float] = deque(maxlen=10)  # one second, without the baseline
        self.readings = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self.on_calibrate)

    def on_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        if not request.zero:
            self.baseline = 0.0
        elif self.window:
            self.baseline = fmean(self.window)
        else:
            raise Refused("there is no reading yet", "call again in a second")
        return CalibrateResponse(self.baseline)

    def forget(self) -> None:
        """Drop the readings of the time before a reset."""
        self.window.clear()

    def read(self, stamp: float, height: float) -> None:
        raw = SEA_LEVEL - GRADIENT * height + uniform(-1e-5, 1e-5)
        self.window.append(raw)
        self.readings.put(Pressure(stamp, raw - self.baseline, self.baseline, 0, 0.0))


def run(node: Node, params: Params) -> None:
    barometer = Barometer(node)
    boot = ""
    for pose in node.poses():
        if pose.boot != boot:
            boot = pose.boot
            barometer.forget()
        if pose.seq % 10 == 0:
            barometer.read(pose.stamp, pose.position.z)


start("pressure", run)
