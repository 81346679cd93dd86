"""Pressure node, with a calibration of its own type beside the usual one."""

from random import uniform
from statistics import fmean

from msgspec import Struct

from quadctl import Node, Params, Refused, Service, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE


class ZeroRequest(Struct):
    zero: bool


class ZeroResponse(Struct):
    baseline: float


ZERO = Service("own/calibrate", ZeroRequest, ZeroResponse, node="pressure", doc="My zeroing.")


def run(node: Node, params: Params) -> None:
    recent, baseline, boot = [], 0.0, ""
    publisher = node.publisher(PRESSURE)

    def set_zero(zero: bool) -> float:
        nonlocal baseline
        if zero and not recent:
            raise Refused("no reading yet", "try again")
        baseline = fmean(recent[-10:]) if zero else 0.0
        return baseline

    node.serve(CALIBRATE, lambda request: CalibrateResponse(set_zero(request.zero)))
    node.serve(ZERO, lambda request: ZeroResponse(set_zero(request.zero)))

    for pose in node.poses():
        if pose.boot != boot:
            recent, boot = [], pose.boot
        if pose.seq % 10 == 0:
            raw = 1013.25 - 0.12 * pose.position.z + uniform(-1e-5, 1e-5)
            recent.append(raw)
            publisher.put(Pressure(pose.stamp, raw - baseline, baseline, 0, 0.0))


start("pressure", run)
