"""The bridge to ROS 2: its cost, and how much later a pose reaches a client behind it."""

import time

import msgspec
import zenoh

from benchmarks import proc
from benchmarks.children import Failed, process
from benchmarks.effort import Effort
from benchmarks.footprint import shares
from benchmarks.raw.session import opened
from benchmarks.results import Results
from benchmarks.system import QUADCTL, running
from quadctl.schemas.messages import Pose
from quadctl.services.ros2 import cdr
from quadctl.services.ros2.messages import PoseStamped
from tests.support.ros import router

_WITHIN, _SETTLED = 20.0, 5.0


class Arrivals:
    """Payloads of a subscription with the times (s) at which they came."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.found: list[tuple[float, bytes]] = []
        self._subscriber = session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.found.append((time.perf_counter(), sample.payload.to_bytes()))


def measure(results: Results, effort: Effort) -> None:
    """Measure the bridge of a vehicle in flight, with a reader of each topic."""
    with running() as where, router() as endpoint:
        words = [QUADCTL, "bridge", "ros2", "--router", endpoint]
        with (
            process(words, where.environment) as bridge,
            opened(where.endpoint) as ours,
            opened(endpoint) as theirs,
        ):
            near, far = Arrivals(ours, "uav/pose"), Arrivals(theirs, "0/uav/pose/**")
            names = ("uav/odom", "tf", "uav/pressure", "uav/cage", "uav/safety_state")
            others = [Arrivals(theirs, f"0/{name}/**") for name in names]
            deadline = time.monotonic() + _WITHIN
            while not all(topic.found for topic in (far, *others)):
                if time.monotonic() > deadline:
                    raise Failed("the bridge publishes nothing")
                time.sleep(0.05)
            time.sleep(_SETTLED)
            near.found.clear()
            far.found.clear()
            found = shares(where, effort.seconds, fly=True)
            results.notes["ros2_processor"] = found
            results.add("ros2_processor", "ours", [found[f"pid {bridge.pid}"]])
            results.add("ros2_memory", "ours", [proc.pss(bridge.pid)])
            results.seconds("ros2_age", "ours", _later(near, far))


def _later(near: Arrivals, far: Arrivals) -> list[float]:
    """Return by how much (s) each pose came later; in flight no two are at the same place."""
    times = {}
    for at, payload in near.found:
        p = msgspec.msgpack.decode(payload, type=Pose).position
        times[p.x, p.y, p.z] = at
    ages = []
    for at, payload in far.found:
        p = cdr.decode(PoseStamped, payload).pose.position
        if (place := (p.x, p.y, p.z)) in times:
            ages.append(at - times[place])
    return ages
