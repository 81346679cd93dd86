"""Intruder with a certificate: uses only Zenoh, follows none of our rules, tries everything.

Prints one JSON document: the keys of all replies, messages, queries and liveliness tokens received.
"""

import json
import subprocess
import sys
import time
from collections.abc import Sequence
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


def sent(
    enter: Sequence[str], endpoint: str, identity: Path, vehicle: str = "uav"
) -> dict[str, list[str]]:
    """Run an intruder with a certificate on a machine, and return the keys that it received."""
    done = subprocess.run(
        [*enter, sys.executable, __file__, endpoint, str(identity), vehicle],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    got: dict[str, list[str]] = json.loads(done.stdout)
    return got


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


def intrude(opened: zenoh.Session, ears: zenoh.Session, vehicle: str) -> dict[str, Any]:
    def of(key: str) -> str:
        return f"{vehicle}/{key.removeprefix('uav/')}" if key.startswith("uav/") else key

    # Within one session messages come back even if the hub denies them: hence two sessions.
    heard: list[str] = []
    listeners = [
        ears.declare_subscriber(of(key), lambda sample: heard.append(str(sample.key_expr)))
        for key in HEARD
    ]
    # Impersonate servers: misdirected queries would arrive here.
    asked: list[str] = []
    servers = [
        ears.declare_queryable(of(key), lambda query: asked.append(str(query.key_expr)))
        for key in ("uav/@srv/goto", "uav/safety/state", "uav/@srv/**")
    ]
    tokens = [
        ears.liveliness().declare_token(key)
        for key in (
            f"{vehicle}/@node/safety2",
            f"{vehicle}/@node/x/@srv/Goto/1/0/{vehicle}%@srv%goto",
        )
    ]
    replied = []
    for service, request in CALLS.items():
        replied += replies(opened, of(f"uav/@srv/{service}"), pack(request))
    for pattern in PATTERNS:
        replied += replies(opened, of(pattern), pack({}))
    for _ in range(3):
        for key, message in PUTS.items():
            opened.put(of(key), pack(message))
            opened.delete(of(key))
        time.sleep(0.05)
    seen = [
        str(reply.ok.key_expr)
        for key in SEEN
        for reply in opened.liveliness().get(of(key), timeout=1.0)
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
    place, who, whose = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    try:
        with session(place, who) as mouth, session(place, who) as ears:
            print(json.dumps(intrude(mouth, ears, whose)))
    except zenoh.ZError:  # not let in at all
        print(json.dumps({"replied": [], "heard": [], "asked": [], "seen": []}))
