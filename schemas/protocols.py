"""Zenoh's protocols, by the form of their addresses and their protection."""

PORTS = ("tcp", "tls", "quic", "udp", "ws")
"""Protocols with an address host:port."""
SECURE = ("tls", "quic")
"""Protocols with certificates at both ends, and encryption."""
LOCAL = ("unixsock-stream",)
"""Protocols with a path."""
