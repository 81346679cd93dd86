"""Ends of a service and a topic in rospy: `python3 -m benchmarks.ros1.node NAME ROLE`.

ROLE is serve, call, listen or publish. Queues are 10 long, like the lab's. The Python is the system's.
"""

import sys
import time

import rospy
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import SetBool, SetBoolResponse

from benchmarks.worker import Arrivals, flood, paced, serve, timed

SERVICE, TOPIC, QUEUE = "/bench/toggle_cage", "/bench/pose", 10
_FRAME = "world" + "x" * 72
"""Frame name that fills the message to about 150 bytes."""


def main(name: str, role: str) -> None:
    """Run one end of a service or a topic."""
    rospy.init_node(name, disable_signals=True)
    if role == "call":
        rospy.wait_for_service(SERVICE, 10)
        once = rospy.ServiceProxy(SERVICE, SetBool)
        kept = rospy.ServiceProxy(SERVICE, SetBool, persistent=True)
        serve(
            call=lambda count: timed(lambda: once(True), count),
            call_persistent=lambda count: timed(lambda: kept(True), count),
        )
    if role == "serve":
        rospy.Service(SERVICE, SetBool, lambda request: SetBoolResponse(success=request.data))
        serve()
    if role == "publish":
        publisher = rospy.Publisher(TOPIC, PoseStamped, queue_size=QUEUE)
        message = PoseStamped()
        message.header.frame_id = _FRAME

        def put(_number: int) -> None:
            now = time.monotonic_ns()
            message.header.stamp.secs, message.header.stamp.nsecs = divmod(now, 10**9)
            publisher.publish(message)

        serve(
            connections=publisher.get_num_connections,
            publish=lambda count, hz: paced(put, count, hz),
            flood=lambda seconds: flood(put, seconds),
        )
    arrivals = Arrivals()

    def heard(message: PoseStamped) -> None:
        stamp = message.header.stamp
        arrivals.add(stamp.secs + stamp.nsecs / 1e9)

    rospy.Subscriber(TOPIC, PoseStamped, heard, queue_size=QUEUE)
    serve(take=arrivals.take, rate=arrivals.rate)


if __name__ == "__main__":
    main(*sys.argv[1:])
