from random import uniform

from quadctl import Refused, start
from quadctl.schemas.messages import Pressure
from quadctl.schemas.services import CalibrateResponse
from quadctl.schemas.topics import CALIBRATE, PRESSURE


def run(node, params):
    base, last, boot, out = 0.0, [], None, node.publisher(PRESSURE)

    def calibrate(q):
        nonlocal base
        if q.zero and not last:
            raise Refused("no readings yet")
        base = sum(last) / len(last) if q.zero else 0.0
        print("CALIBRATE", q, len(last), base, flush=True)
        return CalibrateResponse(base)

    node.serve(CALIBRATE, calibrate)
    for pose in node.poses():
        if pose.boot != boot:
            boot, last = pose.boot, []
        if pose.seq % 10 == 0:
            raw = 1013.25 - 0.12 * pose.position.z + uniform(-1e-5, 1e-5)
            last = [*last, raw][-10:]
            print("RAW", pose.stamp, raw, "minus", base, flush=True)
            out.put(Pressure(pose.stamp, raw - base, base, 0, 0.0))


start("pressure", run)
