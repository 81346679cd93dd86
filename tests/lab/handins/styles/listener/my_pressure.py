"""Barometer as an event-driven class: a handler of every pose takes a reading each 0.1 s."""

from __future__ import annotations

from collections import deque
from random import uniform
from statistics import fmean

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE, PRESSURE

SEA_LEVEL = 1013.25  # hPa
GRADIENT = 0.12  # hPa/m
WINDOW = 1.0  # s


class PressureNode:
    def __init__(self, node: Node) -> None:
        self._node = node
        self._window: deque[tuple[float, float]] = deque()  # (stamp, hPa) of the last second
        self._baseline, self._samples, self._spread = 0.0, 0, 0.0
        self._boot, self._period = "", -1
        self._readings = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self._handle_calibrate)
        node.listen(POSE, self._handle_pose)

    def _handle_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        if not request.zero:
            self._baseline, self._samples, self._spread = 0.0, 0, 0.0
            return CalibrateResponse(0.0)
        values = [value for _, value in self._window]
        if not values:
            raise Refused("the barometer has no reading yet", "call again")
        self._baseline = fmean(values)
        self._samples, self._spread = len(values), max(values) - min(values)
        return CalibrateResponse(self._baseline)

    def _handle_pose(self, pose: Pose) -> None:
        self._node.advance_sim_time(pose.boot, pose.stamp)
        if pose.boot != self._boot:  # the time begins anew, so old readings are of no use
            self._boot, self._period = pose.boot, -1
            self._window.clear()
        period = PRESSURE.period(pose.stamp)
        if period == self._period:
            return
        self._period = period
        raw = SEA_LEVEL - GRADIENT * pose.position.z + uniform(-1e-5, 1e-5)
        self._window.append((pose.stamp, raw))
        while self._window[0][0] <= pose.stamp - WINDOW + 1e-6:
            self._window.popleft()
        self._readings.put(
            Pressure(pose.stamp, raw - self._baseline, self._baseline, self._samples, self._spread)
        )


def run(node: Node, params: Params) -> None:
    PressureNode(node)
    node.spin()


if __name__ == "__main__":
    start("pressure", run)
