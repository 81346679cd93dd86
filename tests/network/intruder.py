"""Somebody with a certificate who keeps to no rule of ours: Zenoh alone, and everything tried.

Prints one JSON document: the keys of the replies, messages and liveliness tokens that it was given.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import zenoh

pack = msgspec.msgpack.encode
CALLS = {
    "goto": {"x": 2.0, "y": 0.0, "z": 1.0},
    "toggle_cage": {"cage_on": False},
    "calibrate_pressure": {"zero": True},
    "hold": {},
    "reset": {},
    "safety/set_params": {"values": {"safety.acceptance_range": 3.0}},
}
SETPOINT = {"boot": "x", "for_seq": 1, "position": {"x": 9.0, "y": 9.0, "z": 9.0}, "brake": False}
WAYPOINT = {"x": 2.0, "y": 0.0, "z": 1.0}
PATTERNS = ["uav/@srv/*", "*/@srv/goto", "uav/**/@srv/goto", "uav/@srv/go$*", "@/**", "**"]
PUTS = {
    "uav/input/position": SETPOINT,
    "uav/input/*": SETPOINT,
    "uav/**": SETPOINT,
    "*/input/position": SETPOINT,
    "uav/input/position_request": WAYPOINT,
    "uav/input/position_re$*": WAYPOINT,
    "uav/pose": {"boot": "x"},
}
HEARD = ["uav/pose", "uav/**", "**", "uav/@call/**", "*/safety/state"]
SEEN = ["*/@node/*", "uav/@node/*", "uav/@node/*/@srv/**", "**"]


def session(endpoint: str, identity: Path) -> zenoh.Session:
    tls = {
        "root_ca_certificate": str(identity / "ca.pem"),
        "connect_private_key": str(identity / "key.pem"),
        "connect_certificate": str(identity / "cert.pem"),
        "enable_mtls": True,
    }
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tls": tls}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def intrude(opened: zenoh.Session, ears: zenoh.Session) -> dict[str, Any]:
    # Within one session all that is said comes back, whatever the hub thinks of it: so two.
    heard: list[str] = []
    listeners = [
        ears.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
        for key in HEARD
    ]
    # Somebody else's part, played: what is asked of it would come here.
    asked: list[str] = []
    servers = [
        ears.declare_queryable(key, lambda query: asked.append(str(query.key_expr)))
        for key in ("uav/@srv/goto", "uav/safety/state", "uav/@srv/**")
    ]
    tokens = [
        ears.liveliness().declare_token(key)
        for key in ("uav/@node/safety2", "uav/@node/x/@srv/Goto/1/0/uav%@srv%goto")
    ]
    replied = []
    for service, request in CALLS.items():
        replied += replies(opened, f"uav/@srv/{service}", pack(request))
    for pattern in PATTERNS:
        replied += replies(opened, pattern, pack({}))
    for _ in range(3):
        for key, message in PUTS.items():
            opened.put(key, pack(message))
            opened.delete(key)
        time.sleep(0.05)
    seen = [
        str(reply.ok.key_expr)
        for key in SEEN
        for reply in opened.liveliness().get(key, timeout=1.0)
        if reply.ok is not None
    ]
    del listeners, servers, tokens
    return {
        "replied": sorted(set(replied)),
        "heard": sorted(set(heard)),
        "asked": sorted(set(asked)),
        "seen": sorted(set(seen)),
    }


def replies(opened: zenoh.Session, key: str, payload: bytes) -> list[str]:
    got = opened.get(key, payload=payload, timeout=1.0, consolidation=zenoh.ConsolidationMode.NONE)
    ours = f"@/{opened.info.zid()}/"
    keys = [str(reply.ok.key_expr) if reply.ok else f"error from {key}" for reply in got]
    return [key for key in keys if not key.startswith(ours)]


if __name__ == "__main__":
    place, who = sys.argv[1], Path(sys.argv[2])
    with session(place, who) as mouth, session(place, who) as ears:
        print(json.dumps(intrude(mouth, ears)))
