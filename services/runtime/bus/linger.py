"""Links of a router to other machines, so that one whose cable is out holds up none of the others."""

import os
import socket
import struct
import sys

LOOKS = 2.0
"""Hz, at which a router looks for new links; none is given up within a second."""
_OFF = struct.pack("ii", 0, 0)


def let_go() -> None:
    """Have every TCP link of this process closed without waiting for what is under way on it.

    Zenoh asks the kernel to wait, up to 10 s, and offers no setting: so long a link to a machine that
    is gone would hold the router's thread that closes it, and all that goes through the router.
    """
    if sys.platform == "win32":
        return
    for name in os.listdir("/dev/fd"):  # noqa: PTH208 - pathlib is slow
        try:
            copy = os.dup(int(name))
        except OSError:
            continue  # the listing's own, or closed since
        try:
            link = socket.socket(fileno=copy)
        except OSError:
            os.close(copy)
            continue  # no socket
        with link:
            if link.family != socket.AF_UNIX and link.type == socket.SOCK_STREAM:
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
