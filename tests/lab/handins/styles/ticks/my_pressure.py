# Lab: barometer. Reads the newest pose at 10 Hz.
from random import uniform

from quadctl import Node, Params, Refused, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, POSE, PRESSURE


def run(node: Node, params: Params):
    sub = node.listen(POSE)
    pub = node.publisher(PRESSURE)
    readings = []  # (stamp, hPa) of the last second
    baseline = 0.0
    boot = None

    def calibrate(request):
        nonlocal baseline
        if request.zero:
            if not readings:
                raise Refused("nothing measured yet", "wait for a reading")
            baseline = sum(value for _, value in readings) / len(readings)
        else:
            baseline = 0.0
        return CalibrateResponse(baseline)

    node.serve(CALIBRATE, calibrate)
    for _ in node.ticks(10):
        pose = sub.value
        if pose is None:
            continue
        node.advance_sim_time(pose.boot, pose.stamp)
        if pose.boot != boot:  # reset, stamps start at 0 again
            boot = pose.boot
            readings.clear()
        now = pose.stamp
        raw = 1013.25 - 0.12 * pose.position.z + uniform(-1e-5, 1e-5)
        readings.append((now, raw))
        while readings[0][0] < now - 0.995:
            readings.pop(0)
        pub.put(Pressure(now, raw - baseline, baseline, 0, 0.0))


start("pressure", run)
