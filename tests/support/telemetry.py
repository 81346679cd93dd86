"""Telemetry of many vehicles, with only Zenoh and MessagePack.

    python telemetry.py ENDPOINT FIRST COUNT HZ

Publishes poses of each vehicle at a rate, spread over the period, until killed. `seq` counts
from 0 for each vehicle. Each vehicle is announced as a node.
"""

import json
import sys
import time
from typing import Any

import msgspec
import zenoh


def main(endpoint: str, first: int, count: int, hz: float) -> None:
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
    }
    names = [f"uav{number}" for number in range(first, first + count)]
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        publishers = [session.declare_publisher(f"{name}/pose") for name in names]
        tokens = [session.liveliness().declare_token(f"{name}/@node/dynamics") for name in names]
        # What is sent before the hub tells of a subscriber goes nowhere.
        statuses: list[Any] = [each.matching_status for each in publishers]
        while not all(status.matching for status in statuses):
            time.sleep(0.01)
            statuses = [each.matching_status for each in publishers]
        began = time.monotonic()
        for number in range(sys.maxsize):
            seq, index = divmod(number, len(tokens))
            time.sleep(max(began + number / (count * hz) - time.monotonic(), 0))
            publishers[index].put(msgspec.msgpack.encode(pose(seq)))


def pose(seq: int) -> dict[str, object]:
    """Return a pose of the same size as a real one."""
    point = {"x": 0.1, "y": 0.2, "z": 0.3}
    return {
        "boot": "0badcafe", "seq": seq, "stamp": seq / 10, "position": point, "velocity": point,
        "orientation": {"w": 1.0, **point}, "body_rates": point,
    }  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
