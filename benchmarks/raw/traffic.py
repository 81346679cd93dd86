"""Traffic of our system on bare Zenoh, without its work: `traffic.py ENDPOINT ROLE BYTES`.

ROLE is hub, vehicle (publishes at 100 Hz, receives setpoints), monitor (receives from the vehicle,
publishes to it at 20 Hz) or sensor (receives from the vehicle, publishes at 10 Hz).
"""

import itertools
import json
import sys
import time
from typing import NoReturn

import zenoh

from benchmarks.raw.session import opened

HZ = {"vehicle": 100, "monitor": 20, "sensor": 10}
HEARS = {"vehicle": "raw/monitor", "monitor": "raw/vehicle", "sensor": "raw/vehicle"}


def hub(endpoint: str) -> NoReturn:
    """Run the router."""
    config = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"delay": 0, "multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))):
        while True:
            time.sleep(1)


def main(endpoint: str, role: str, size: str) -> None:
    """Publish and subscribe until killed."""
    if role == "hub":
        hub(endpoint)
    session, message, hz = opened(endpoint), bytes(int(size)), HZ[role]
    _kept = session.declare_subscriber(HEARS[role], lambda sample: sample.payload.to_bytes())
    publisher = session.declare_publisher(f"raw/{role}")
    began = time.monotonic()
    for count in itertools.count(1):
        publisher.put(message)
        time.sleep(max(began + count / hz - time.monotonic(), 0))


if __name__ == "__main__":
    main(*sys.argv[1:])
