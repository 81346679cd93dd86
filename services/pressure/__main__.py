"""The barometer's process: `sensors/pressure` and `calibrate_pressure`."""

import random
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from schemas.contract import period
from schemas.messages import Pose
from schemas.params import Params
from schemas.requests import CalibrateRequest, CalibrateResponse
from schemas.topics import CALIBRATE, POSE, PRESSURE
from services.pressure.channel import has_pressure, hectopascals
from services.pressure.faults import Faults
from services.pressure.sensor import Barometer, NoSample
from services.pressure.simulated import Simulated
from services.runtime import iio
from services.runtime.entry import start
from services.runtime.errors import NotReady, QuadctlError
from services.runtime.node import Node
from services.runtime.params import launch_lines

_FIRST_POSE = 1.0
"""How long (s) readiness waits for a first pose, so that who sees us ready can calibrate."""

Sense = Callable[[Pose | None], float | None]
"""The raw pressure now, hPa, None where there is none yet."""


class Output:
    """The way of a raw reading: what is wrong with it, the baseline, the topic."""

    def __init__(
        self, node: Node, params: Params, sense: Sense, clock: Callable[[], float]
    ) -> None:
        """`clock` is the time of `read`, now."""
        self._log, self._sense, self._clock = node.log, sense, clock
        self._fault, self._told = params.pressure.fault, "none"
        self._readings = node.publisher(PRESSURE, lambda: params.pressure.rate)
        self._barometer = Barometer(params.pressure)
        self._faults = Faults(self._fault, _stream(params, "faults"))
        self._begun = time.monotonic()
        node.on_params = self.tell_fault
        node.serve(CALIBRATE, self._calibrate)

    def tell_fault(self) -> None:
        """Say in the log that a fault has been put in, or taken out."""
        if self._fault.kind != self._told:
            self._told = self._fault.kind
            self._log.warning("fault: %s", self._told)

    def read(self, now: float, pose: Pose | None) -> None:
        """Take a reading and publish it. `pose` is the newest; `now` the clock's time, s."""
        raw = self._sense(pose)
        if raw is None:
            return
        # A real sensor works without a simulation too, and then with a time of its own.
        stamp = now - self._begun if pose is None else pose.stamp
        given = self._faults.through(stamp, raw)
        if given is not None:
            self._readings.put(self._barometer.take(now, stamp, given))

    def _calibrate(self, request: CalibrateRequest) -> CalibrateResponse:
        try:
            baseline = self._barometer.calibrate(self._clock(), zero=request.zero)
        except NoSample:
            raise NotReady(
                "the barometer has had no sample in the last second",
                "is dynamics up? `quadctl status`; is a fault put in? `quadctl param get pressure`",
            ) from None
        self._log.info("baseline: %.4f hPa", baseline)
        return CalibrateResponse(baseline)


def run(node: Node, params: Params) -> None:
    """Publish readings: at the vehicle's height from the first pose on, or of a real sensor.

    In real time the sensor has a rhythm of its own, else the poses' simulated time gives it.
    """
    pressure, real_time, last = params.pressure, params.dynamics.speed == 1, -1

    def on_pose(pose: Pose) -> None:
        nonlocal last
        now = period(pose.stamp, pressure.rate)
        if now != last:
            last = now
            output.read(pose.stamp, pose)

    def simulated_time() -> float:
        return 0.0 if poses.value is None else poses.value.stamp

    for line in launch_lines(pressure):
        node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the baseline is 0 again")
    sense = _real(node, params) if pressure.source == "iio" else _simulated(params)
    output = Output(node, params, sense, time.monotonic if real_time else simulated_time)
    poses = node.listen(POSE, None if real_time else on_pose)
    output.tell_fault()
    node.wait_for(lambda: poses.value is not None, _FIRST_POSE)
    for now in node.ticks(lambda: pressure.rate):
        if real_time:
            output.read(now, poses.value)


def _simulated(params: Params) -> Sense:
    lab = random.Random(params.dynamics.seed)
    sensor = Simulated(params.pressure, lab, partial(_stream, params))
    return lambda pose: (
        None if pose is None else sensor.read(pose.boot, pose.stamp, pose.position.z)
    )


def _real(node: Node, params: Params) -> Sense:
    """Read once before the node is ready, so that a launch without its sensor fails."""
    folder = device(params.pressure.iio)
    read = partial(iio.read, folder)
    node.log.info("%s shows %.4f hPa", folder, hectopascals(str(folder), read))
    return lambda _pose: hectopascals(str(folder), read)


def device(named: str, root: Path = iio.DEVICES) -> Path:
    """The sensor's folder: the one named, else the first under the root that has pressure."""
    if named:
        return Path(named)
    for folder in iio.devices(root):
        if has_pressure(partial(iio.read, folder)):
            return folder
    raise QuadctlError(
        f"no device under {root} has pressure",
        "plug a barometer in, load its driver, or name its folder in pressure.iio",
    )


def _stream(params: Params, name: str) -> random.Random:
    """A stream of random numbers of its own, the same in every run with the same seed."""
    return random.Random(f"{params.dynamics.seed} pressure {name}")


if __name__ == "__main__":
    start("pressure", run)
