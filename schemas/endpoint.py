"""Zenoh's protocols, as the first part of an endpoint such as tls/lab2:7447."""

PORTS = ("tcp", "tls", "quic", "udp", "ws")
"""Those on host:port."""
SECURE = ("tls", "quic")
"""Those of them by which both ends show a certificate, and all between is encrypted."""
LOCAL = ("unixsock-stream",)
"""Those on a path."""
