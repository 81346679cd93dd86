"""The barometer's process: `sensors/pressure` and `calibrate_pressure`."""

import random

from schemas.contract import period
from schemas.messages import Pose
from schemas.params import Params
from schemas.requests import CalibrateRequest, CalibrateResponse
from schemas.topics import CALIBRATE, POSE, PRESSURE
from services.pressure.sensor import Barometer, NoSample
from services.runtime.entry import start
from services.runtime.errors import NotReady
from services.runtime.node import Node
from services.runtime.params import launch_lines

_FIRST_POSE = 1.0
"""How long (s) readiness waits for a first pose, so that who sees us ready can calibrate."""


def run(node: Node, params: Params) -> None:
    """Publish a reading at the vehicle's height, from the first pose on.

    In real time the sensor has a rhythm of its own, else the poses' simulated time gives it.
    """
    readings = node.publisher(PRESSURE, lambda: params.pressure.rate)
    barometer = Barometer(params.pressure)
    noise = random.Random(params.dynamics.seed)

    def calibrate(request: CalibrateRequest) -> CalibrateResponse:
        try:
            baseline = barometer.calibrate(zero=request.zero)
        except NoSample:
            raise NotReady(
                "the barometer has no sample yet", "is dynamics up? `quadctl status`"
            ) from None
        node.log.info("baseline: %.4f hPa", baseline)
        return CalibrateResponse(baseline)

    def read(now: float, pose: Pose) -> None:
        height, uniform = pose.position.z, noise.uniform(-1, 1)
        readings.put(barometer.sample(now, pose.stamp, height, uniform))

    real_time, last = params.dynamics.speed == 1, -1

    def on_pose(pose: Pose) -> None:
        nonlocal last
        now = period(pose.stamp, params.pressure.rate)
        if now != last:
            last = now
            read(pose.stamp, pose)

    poses = node.listen(POSE, None if real_time else on_pose)
    node.serve(CALIBRATE, calibrate)
    for line in launch_lines(params.pressure):
        node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the baseline is 0 again")
    node.wait_for(lambda: poses.value is not None, _FIRST_POSE)
    for now in node.ticks(lambda: params.pressure.rate):
        if real_time and (pose := poses.value) is not None:
            read(now, pose)


if __name__ == "__main__":
    start("pressure", run)
