"""Session of bare Zenoh with a hub."""

import json

import zenoh

_HUB_WAIT_MS = 5000


def opened(endpoint: str) -> zenoh.Session:
    """Open a client like the Zenoh manual, with our nodes' settings; wait for the hub."""
    retry = {"period_init_ms": 10, "period_max_ms": 10, "period_increase_factor": 1}
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": _HUB_WAIT_MS, "retry": retry},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
