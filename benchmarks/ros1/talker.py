#!/usr/bin/python3
"""Node that publishes a pose at 50 Hz."""

import contextlib

import rospy
from geometry_msgs.msg import PoseStamped

rospy.init_node("talker")
publisher = rospy.Publisher(rospy.get_name() + "/out", PoseStamped, queue_size=10)
rate = rospy.Rate(50)
with contextlib.suppress(rospy.ROSInterruptException):
    while not rospy.is_shutdown():
        publisher.publish(PoseStamped())
        rate.sleep()
