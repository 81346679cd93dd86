"""The links of a router are closed at once, whatever is under way on them."""

import socket
import struct

from quadctl.services.runtime.bus.router import disable_tcp_linger


def test_what_zenoh_has_set_is_taken_back_from_tcp_links_alone():
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
