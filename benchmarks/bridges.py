"""The bridges: the cost of each, and how much later a pose reaches a client behind it."""

import time
from collections.abc import Iterable, Iterator
from itertools import cycle

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
from quadctl.services.bridges.ros2 import messages
from quadctl.services.runtime.bus.session import free_port
from tests.support.autopilot import rig
from tests.support.foxglove import FoxgloveClient, serves
from tests.support.mavlink import GroundStation
from tests.support.ros import router

_WITHIN, _SETTLED = 20.0, 5.0
Place = tuple[float, float, float]
PLACES = cycle(((2.0, 0.0, 1.0), (0.0, 2.0, 2.0)))


class Arrivals:
    """Payloads of a subscription with the times (s) at which they came."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.found: list[tuple[float, bytes]] = []
        self._subscriber = session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.found.append((time.perf_counter(), sample.payload.to_bytes()))


def measure_ros2(results: Results, effort: Effort) -> None:
    """Measure the bridge to ROS 2 of a vehicle in flight, with a reader of each topic."""
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
            results.seconds("ros2_age", "ours", _later(near, _ros_poses(far)))


def measure_foxglove(results: Results, effort: Effort) -> None:
    """Measure the bridge to Foxglove of a vehicle in flight, with a client of all topics."""
    with running() as where:
        port = free_port()
        words = [QUADCTL, "bridge", "foxglove", "--port", str(port)]
        with process(words, where.environment) as bridge, opened(where.endpoint) as ours:
            near, deadline = Arrivals(ours, "uav/pose"), time.monotonic() + _WITHIN
            while not serves(port):
                if time.monotonic() > deadline:
                    raise Failed("the bridge does not serve")
                time.sleep(0.05)
            with FoxgloveClient(port, everything=True) as client:
                client.message("uav/pose")
                time.sleep(_SETTLED)
                near.found.clear()
                client.messages.clear()
                found = shares(where, effort.seconds, fly=True)
                results.notes["foxglove_processor"] = found
                results.add("foxglove_processor", "ours", [found[f"pid {bridge.pid}"]])
                results.add("foxglove_memory", "ours", [proc.pss(bridge.pid)])
                results.seconds("foxglove_age", "ours", _later(near, _foxglove_poses(client)))


def measure_mavlink(results: Results, effort: Effort) -> None:
    """Measure the bridge to MAVLink of a vehicle in flight, with a ground station that reads."""
    with running() as where, GroundStation() as station:
        words = [QUADCTL, "bridge", "mavlink", "--to", f"udpout:127.0.0.1:{station.port}"]
        with process(words, where.environment) as bridge:
            station.wait("GLOBAL_POSITION_INT", since=0)
            time.sleep(_SETTLED)
            found = shares(where, effort.seconds, fly=True)
            results.notes["mavlink_processor"] = found
            results.add("mavlink_processor", "ours", [found[f"pid {bridge.pid}"]])
            results.add("mavlink_memory", "ours", [proc.pss(bridge.pid)])


def measure_autopilot(results: Results, effort: Effort) -> None:
    """Measure the adapter of an autopilot in flight: our own vehicle, behind its bridge."""
    with rig() as made:
        made.give()
        pid, vehicle = made.pid("dynamics"), made.ours.vehicle
        began, before = time.perf_counter(), proc.busy(pid)
        while (seconds := time.perf_counter() - began) < effort.seconds:
            vehicle.goto(*next(PLACES), settle=True)
        results.add("autopilot_processor", "ours", [100 * (proc.busy(pid) - before) / seconds])
        results.add("autopilot_memory", "ours", [proc.pss(pid)])


Arrived = tuple[float, Place]
"""Time (s) at which a pose came, and its place."""


def _ros_poses(far: Arrivals) -> Iterator[Arrived]:
    for at, payload in far.found:
        p = messages.decode("geometry_msgs/msg/PoseStamped", payload).pose.position
        yield at, (p.x, p.y, p.z)


def _foxglove_poses(client: FoxgloveClient) -> Iterator[Arrived]:
    for message in client.messages:
        if message.topic == "uav/pose":
            p = msgspec.json.decode(message.data, type=Pose).position
            yield message.came, (p.x, p.y, p.z)


def _later(near: Arrivals, far: Iterable[Arrived]) -> list[float]:
    """Return by how much (s) each pose came later; in flight no two are at the same place."""
    times = {}
    for at, payload in near.found:
        p = msgspec.msgpack.decode(payload, type=Pose).position
        times[p.x, p.y, p.z] = at
    return [at - times[place] for at, place in far if place in times]
