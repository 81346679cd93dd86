"""Typed ends of a service and a topic: `python -m benchmarks.ours.node REALM NAME ROLE`.

ROLE is serve, call, listen or publish.
"""

import sys
import threading
import time

from benchmarks.worker import Arrivals, flood, paced, serve, timed
from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Velocity
from quadctl.schemas.services import ToggleCageRequest, ToggleCageResponse
from quadctl.schemas.topics import POSE, TOGGLE_CAGE
from quadctl.services.runtime.bus.calls import ServiceClient
from quadctl.services.runtime.bus.session import address_of, open_client
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.realm import Realm

VEHICLE = "uav"
_WAIT = 5.0


def pose(number: int) -> Pose:
    """Return a pose with every field filled; its stamp is the monotonic clock."""
    return Pose(
        "0123456789abcdef", number, time.monotonic(),
        Position(1.25, -2.5, 1.0625), Velocity(0.1, 0.2, 0.3),
        Quaternion(1.0, 0.01, 0.02, 0.03), BodyRates(0.1, 0.2, 0.3),
    )  # fmt: skip


def main(realm: str, name: str, role: str) -> None:
    """Run one end of a service or a topic."""
    session = open_client(address_of(Realm(realm)), wait=_WAIT)
    if role == "call":
        caller = ServiceClient(session, VEHICLE, TOGGLE_CAGE)
        request = ToggleCageRequest(True)
        serve(call=lambda count: timed(lambda: caller.call(request, 3.0), count))
    node = Node(name, VEHICLE, session)
    if role == "publish":
        publisher = node.publisher(POSE)
        node.ready()
        serve(
            publish=lambda count, hz: paced(lambda i: publisher.put(pose(i)), count, hz),
            flood=lambda seconds: flood(lambda i: publisher.put(pose(i)), seconds),
        )
    arrivals = Arrivals()
    if role == "serve":
        node.serve(TOGGLE_CAGE, lambda request: ToggleCageResponse(request.cage_on), inline=True)
    else:
        node.listen(POSE, lambda message: arrivals.add(message.stamp), inline=True)
    node.ready()
    # The loop has the main thread, as in every node; a second thread reads the benchmark's requests.
    asked = {"take": arrivals.take, "rate": arrivals.rate}
    threading.Thread(target=serve, kwargs=asked, daemon=True).start()
    node.spin()


if __name__ == "__main__":
    main(*sys.argv[1:])
