#!/usr/bin/python3
"""Node that writes the time of the first message of all four talkers to the file $FIRST."""

import json
import os
import time
from pathlib import Path

import rospy
from geometry_msgs.msg import PoseStamped

came: dict[str, float] = {}


def heard(_message: PoseStamped, name: str) -> None:
    if name not in came:
        came[name] = time.monotonic()
        if len(came) == 4:
            file = Path(os.environ["FIRST"])
            fresh = file.with_suffix(".new")
            fresh.write_text(json.dumps(came), encoding="utf-8")
            fresh.replace(file)


rospy.init_node("first")
for talker in "abcd":
    rospy.Subscriber(f"/{talker}/out", PoseStamped, heard, callback_args=talker, queue_size=10)
rospy.spin()
