"""The barometer's process: `sensors/pressure` and `calibrate_pressure`."""

import random

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
    """Publish a reading at the vehicle's height, from the first pose on."""
    pose = node.listen(POSE)
    readings = node.publisher(PRESSURE, params.pressure.rate)
    barometer = Barometer(params.pressure)
    noise = random.Random(params.pressure.seed)  # noqa: S311 - a simulation's noise

    def calibrate(request: CalibrateRequest) -> CalibrateResponse:
        try:
            baseline = barometer.calibrate(zero=request.zero)
        except NoSample:
            raise NotReady(
                "the barometer has no sample yet", "is dynamics up? `quadctl status`"
            ) from None
        node.log.info("baseline: %.4f hPa", baseline)
        return CalibrateResponse(baseline)

    node.serve(CALIBRATE, calibrate)
    for line in launch_lines(params.pressure):
        node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the baseline is 0 again")
    node.wait_for(lambda: pose.value is not None, _FIRST_POSE)
    for now in node.ticks(lambda: params.pressure.rate):
        if pose.value is not None:
            height = pose.value.position.z
            readings.put(barometer.sample(now, pose.value.stamp, height, noise.uniform(-1, 1)))


if __name__ == "__main__":
    start("pressure", run)
