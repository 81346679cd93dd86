"""Where the console listens, and how a browser finds it."""

import errno
import os
import socket
from ipaddress import ip_address

from services.runtime.errors import AlreadyServed, QuadctlError, UsageError

_MOST = 65_535


def bound(host: str, port: int, *, exactly: bool) -> socket.socket:
    """A socket that listens on a port, or on a free one where that is taken and not `exactly`.

    Raises AlreadyServed for a taken port, UsageError for what is none.
    """
    if not 0 <= port <= _MOST:
        raise UsageError(f"--port {port}: there is no such port", f"0 (any) to {_MOST}")
    family = socket.AF_INET6 if ip_address(host).version == 6 else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    if os.name == "posix":
        # A port just left is free again; on Windows this would take one that is in use.
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
        made.listen()
    except OSError as error:
        made.close()
        if error.errno != errno.EADDRINUSE:
            raise QuadctlError(f"cannot listen on {host} port {port}: {error.strerror}") from error
        if not exactly:
            return bound(host, 0, exactly=True)
        raise AlreadyServed(
            f"port {port} of {host} is taken", "another console? --port 0 takes any free one"
        ) from error
    return made


def urls(listening: socket.socket, token: str) -> tuple[str, str]:
    """The page's address for who may control, and for who only watches."""
    host, port = listening.getsockname()[:2]
    address = ip_address(host)
    if address.is_unspecified:
        # No browser can go to 0.0.0.0; this machine goes by its name there.
        name = socket.gethostname().lower()
    else:
        name = f"[{host}]" if address.version == 6 else host
    watch = f"http://{name}:{port}/"
    return f"{watch}?token={token}", watch
