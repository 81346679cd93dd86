"""Barometer as pure functions over a frozen record."""

from dataclasses import dataclass, replace
from random import uniform

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE

SAMPLES = 10  # of the last second


@dataclass(frozen=True)
class Sensor:
    last: tuple[float, ...] = ()
    baseline: float = 0.0


def air_pressure(height: float) -> float:
    return 1013.25 - 0.12 * height + uniform(-1e-5, 1e-5)


def with_reading(sensor: Sensor, raw: float) -> Sensor:
    return replace(sensor, last=(*sensor.last, raw)[-SAMPLES:])


def calibrated(sensor: Sensor, *, zero: bool) -> Sensor:
    match (zero, sensor.last):
        case (False, _):
            return replace(sensor, baseline=0.0)
        case (True, ()):
            raise Refused("there is no reading to calibrate with", "wait for one")
        case (True, last):
            return replace(sensor, baseline=sum(last) / len(last))
    return sensor


def run(node: Node, params: Params) -> None:
    readings, sensor = node.publisher(PRESSURE), Sensor()

    def calibrate(request: CalibrateRequest) -> CalibrateResponse:
        nonlocal sensor
        sensor = calibrated(sensor, zero=request.zero)
        return CalibrateResponse(sensor.baseline)

    node.serve(CALIBRATE, calibrate)
    for pose in node.poses():
        if pose.seq % 10 == 0:
            raw = air_pressure(pose.position.z)
            sensor = with_reading(sensor, raw)
            readings.put(Pressure(pose.stamp, raw - sensor.baseline, sensor.baseline, 0, 0.0))


start("pressure", run)
