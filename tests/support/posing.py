"""Impostor of the hub: listens with a certificate of another role until it is ended."""

import json
import sys
from pathlib import Path

import zenoh


def main(endpoint: str, identity: Path) -> None:
    tls = {
        "root_ca_certificate": str(identity / "ca.pem"),
        "listen_private_key": str(identity / "key.pem"),
        "listen_certificate": str(identity / "cert.pem"),
    }
    config = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tls": tls}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))):
        print("listening", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
