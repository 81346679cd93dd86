"""TCP links of a router close at once, without lingering on unsent data."""

import socket
import struct

from quadctl.services.runtime.bus.router import cut_tcp_links, disable_tcp_linger


def test_lingering_is_disabled_on_tcp_sockets_only():
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as link,
        socket.socket(socket.AF_UNIX) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
    ):
        for each in (link, other):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 10))
        disable_tcp_linger()
        lingers = [
            struct.unpack("ii", each.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
            for each in (link, other)
        ]
        assert lingers[0][0] == 0
        assert lingers[1] == (1, 10)
        assert link.getblocking()


def test_all_tcp_links_are_cut_at_once():
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname(), timeout=5) as far,
    ):
        near, _ = server.accept()
        with near:
            cut_tcp_links()
            assert far.recv(1) == b""
