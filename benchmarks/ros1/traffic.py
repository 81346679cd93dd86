#!/usr/bin/python3
"""Traffic of our system in rospy, without its work: `traffic.py ROLE BYTES`, as on bare Zenoh."""

import contextlib
import sys

import rospy
from geometry_msgs.msg import PoseStamped

HZ = {"vehicle": 100, "monitor": 20, "sensor": 10}
HEARS = {"vehicle": "monitor", "monitor": "vehicle", "sensor": "vehicle"}
REST = 72
"""Size (bytes) of the message without the name of its frame."""

role, size = sys.argv[1:]
rospy.init_node(role)
publisher = rospy.Publisher(f"/{role}", PoseStamped, queue_size=10)
rospy.Subscriber(f"/{HEARS[role]}", PoseStamped, lambda message: message.pose, queue_size=10)
rate, message = rospy.Rate(HZ[role]), PoseStamped()
message.header.frame_id = "x" * (int(size) - REST)
with contextlib.suppress(rospy.ROSInterruptException):
    while not rospy.is_shutdown():
        publisher.publish(message)
        rate.sleep()
