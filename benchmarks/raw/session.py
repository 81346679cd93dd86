"""Bare Zenoh's way to a hub."""

import json

import zenoh

_HUB_WAIT_MS = 5000


def opened(endpoint: str) -> zenoh.Session:
    """A client as the Zenoh manual has it, with our nodes' settings; waits for the hub."""
    retry = {"period_init_ms": 10, "period_max_ms": 10, "period_increase_factor": 1}
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": _HUB_WAIT_MS, "retry": retry},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
