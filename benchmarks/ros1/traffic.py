#!/usr/bin/python3
"""The traffic of our system in rospy, nothing behind it: `traffic.py ROLE`, as on bare Zenoh."""

import contextlib
import sys

import rospy
from geometry_msgs.msg import PoseStamped

HZ = {"vehicle": 100, "monitor": 20, "sensor": 10}
HEARS = {"vehicle": "monitor", "monitor": "vehicle", "sensor": "vehicle"}

role = sys.argv[1]
rospy.init_node(role)
publisher = rospy.Publisher(f"/{role}", PoseStamped, queue_size=10)
rospy.Subscriber(f"/{HEARS[role]}", PoseStamped, lambda message: message.pose, queue_size=10)
rate, message = rospy.Rate(HZ[role]), PoseStamped()
message.header.frame_id = "world" + "x" * 72
with contextlib.suppress(rospy.ROSInterruptException):
    while not rospy.is_shutdown():
        publisher.publish(message)
        rate.sleep()
