"""Pressure node: a sensor, a calibration and the node that joins them."""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections import deque
from random import uniform
from statistics import mean

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE

logger = logging.getLogger("my_pressure")


class Sensor(ABC):
    """Source of raw readings, hPa."""

    @abstractmethod
    def measure(self, pose: Pose) -> float:
        """Return the air's pressure at a pose, hPa."""


class SimulatedSensor(Sensor):
    SEA_LEVEL = 1013.25
    GRADIENT = 0.12
    NOISE = 1e-5

    def measure(self, pose: Pose) -> float:
        noise = uniform(-self.NOISE, self.NOISE)
        return self.SEA_LEVEL - self.GRADIENT * pose.position.z + noise


class Calibration:
    """Baseline, and the last second's raw readings, hPa."""

    READINGS_PER_SECOND = 10

    def __init__(self) -> None:
        self._readings: deque[float] = deque(maxlen=self.READINGS_PER_SECOND)
        self._baseline = 0.0

    @property
    def baseline(self) -> float:
        return self._baseline

    def add(self, raw: float) -> None:
        self._readings.append(raw)

    def forget_readings(self) -> None:
        self._readings.clear()

    def zero(self) -> None:
        if not self._readings:
            raise Refused("the sensor has no reading yet", "call again in a second")
        self._baseline = mean(self._readings)

    def undo(self) -> None:
        self._baseline = 0.0

    def apply(self, raw: float) -> float:
        return raw - self._baseline


class PressureNode:
    def __init__(self, node: Node, sensor: Sensor) -> None:
        self._sensor = sensor
        self._calibration = Calibration()
        self._boot = ""
        self._publisher = node.publisher(PRESSURE)
        node.serve(CALIBRATE, self._on_calibrate)

    def _on_calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        if request.zero:
            self._calibration.zero()
        else:
            self._calibration.undo()
        logger.info("baseline %.4f hPa", self._calibration.baseline)
        return CalibrateResponse(self._calibration.baseline)

    def on_pose(self, pose: Pose) -> None:
        if pose.boot != self._boot:
            self._boot = pose.boot
            self._calibration.forget_readings()
        if pose.seq % 10 != 0:
            return
        raw = self._sensor.measure(pose)
        self._calibration.add(raw)
        self._publisher.put(
            Pressure(
                stamp=pose.stamp,
                pressure=self._calibration.apply(raw),
                baseline=self._calibration.baseline,
                samples=0,
                spread=0.0,
            )
        )


def run(node: Node, params: Params) -> None:
    logging.basicConfig(level=logging.INFO)
    pressure = PressureNode(node, SimulatedSensor())
    for pose in node.poses():
        pressure.on_pose(pose)
        time.sleep(0.01)


start("pressure", run)
