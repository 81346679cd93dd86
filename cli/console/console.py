"""`console`: the address and port to listen on, the URLs, and the browser."""

import errno
import importlib.util
import os
import secrets
import socket
import webbrowser
from ipaddress import ip_address
from typing import Annotated

from msgspec import structs

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.runtime import realm
from quadctl.services.runtime.errors import AlreadyServed, QuadctlError, Unreachable, UsageError
from quadctl.services.runtime.security.endpoints import url_host
from quadctl.services.runtime.vehicles import vehicles_of

_MOST = 65_535


def listening_socket(host: str, port: int, *, exactly: bool) -> socket.socket:
    """Return a socket that listens on a port; on a free one if it is taken and not `exactly`.

    Raises AlreadyServed for a taken port, UsageError for an impossible one.
    """
    if not 0 <= port <= _MOST:
        raise UsageError(f"--port {port}: there is no such port", f"0 (any) to {_MOST}")
    family = socket.AF_INET6 if ip_address(host).version == 6 else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    if os.name == "posix":
        # Lets a port just closed be reused; on Windows it would take one that is in use.
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
        made.listen()
    except OSError as error:
        made.close()
        if error.errno != errno.EADDRINUSE:
            raise QuadctlError(f"cannot listen on {host} port {port}: {error.strerror}") from error
        if not exactly:
            return listening_socket(host, 0, exactly=True)
        raise AlreadyServed(
            f"port {port} of {host} is taken", "another console? --port 0 takes any free one"
        ) from error
    return made


def urls(listening: socket.socket, token: str) -> tuple[str, str]:
    """Return the page's address with control, and the one that only watches."""
    host, port = listening.getsockname()[:2]
    address = ip_address(host)
    # Browsers cannot open 0.0.0.0: use the name of this machine.
    name = socket.gethostname().lower() if address.is_unspecified else url_host(host)
    watch = f"http://{name}:{port}/"
    return f"{watch}?token={token}", watch


_PORT = 8470


def console(
    options: Options,
    port: Annotated[
        int | None, Option(f"Port to listen on (default: {_PORT}, or a free one if that is taken).")
    ] = None,
    browse: Annotated[bool, Option("Open the page in a browser.", ("--open",))] = False,
    host: Annotated[str, Option("Address to listen on.")] = "127.0.0.1",
    insecure: Annotated[
        bool, Option("Let other machines connect; their traffic is not encrypted.")
    ] = False,
) -> None:
    """Fly from a web page: the vehicle in its cage, its readings, processes and parameters.

    The token in the first address lets the page control; without it a page only watches.

    Example: quadctl console --open
    """
    if importlib.util.find_spec("nicegui") is None:
        raise QuadctlError(
            "the console needs NiceGUI, which is not installed",
            "`pip install 'quadctl[console]'`, into the same environment",
        )
    _check(host, insecure=insecure)
    # Fail here, not on a page, if nothing runs or answers.
    with context.connect(structs.replace(options, named=options.named or realm.DEFAULT)):
        vehicles = vehicles_of(options.realm, options.connect, options.timeout)
    first = options.named or vehicles[0]
    if first not in vehicles:
        raise Unreachable(f"there is no vehicle {first}", f"there is {realm.listed(vehicles)}")
    from quadctl.cli.console.server import serve

    listening = listening_socket(host, _PORT if port is None else port, exactly=port is not None)
    token = secrets.token_urlsafe(16)
    control, watch = urls(listening, token)
    if options.json:
        output.document({"url": control, "watch": watch, "vehicles": vehicles})
    else:
        output.line(f"control: {control}")
        output.line(f"watch:   {watch}")
        output.note("Ctrl-C ends the console; the vehicle keeps running")
    if insecure:
        output.note(
            "warning: other machines can watch, and anyone with this address or able to read the"
            " network's traffic, which is not encrypted, can fly"
        )
    if browse:
        webbrowser.open(control)
    serve(options, first, listening, token, beyond=insecure)


def _check(host: str, *, insecure: bool) -> None:
    try:
        loopback = ip_address(host).is_loopback
    except ValueError as error:
        raise UsageError(
            f"--host {host}: not an IP address", "127.0.0.1, ::1 or 0.0.0.0"
        ) from error
    if not loopback and not insecure:
        raise UsageError(
            f"--host {host} lets other machines watch; anyone able to read the traffic, which is"
            " not encrypted, could fly",
            "add --insecure to allow this, or use a tunnel: ssh -L 8470:127.0.0.1:8470 HOST",
        )
