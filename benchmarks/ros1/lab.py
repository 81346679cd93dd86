#!/usr/bin/python3
"""Node of the lab, as small as possible: 10 Hz pressure, a parameter, the cage's service."""

import contextlib

import rospy
from geometry_msgs.msg import Vector3
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse


def toggle(request: SetBoolRequest) -> SetBoolResponse:
    return SetBoolResponse(success=request.data)


rospy.init_node("lab")
rospy.set_param("~acceptance_range", 0.5)
pressure = rospy.Publisher("/uav/sensors/pressure", Float64, queue_size=10)
rospy.Subscriber("/uav/input/position_request", Vector3, lambda _: None, queue_size=10)
rospy.Service("/toggle_cage", SetBool, toggle)
rate = rospy.Rate(10)
with contextlib.suppress(rospy.ROSInterruptException):
    while not rospy.is_shutdown():
        pressure.publish(1013.2475)
        rate.sleep()
