"""`bridge foxglove`: the process of the bridge, in the place of the command."""

import os
import secrets
import socket
import ssl
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.security.bridge_access import check_listener
from quadctl.services.runtime.security.endpoints import url_host

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
"""Layout with the scene, plots, the state and buttons of the vehicle `uav`."""
VARIABLE = "QUADCTL_FOXGLOVE_TOKEN"
_MOST = 65_535
_SHORTEST = 8
"""Characters of a token that nobody guesses."""


def foxglove(
    options: Options,
    port: Annotated[int, Option("Port of the server.", metavar="N")] = 8765,
    control: Annotated[
        bool, Option("Let clients with the token in their address act, not only watch.")
    ] = False,
    host: Annotated[str, Option("Address to listen on; beyond this machine, with --cert.")] = (
        "127.0.0.1"
    ),
    cert: Annotated[Path | None, Option("Certificate of the server, PEM, for wss.")] = None,
    key: Annotated[Path | None, Option("Key of the certificate, if it is in another file.")] = None,
    origin: Annotated[
        list[str] | None, Option("Site with a viewer, e.g. https://lab.example.org.", metavar="URL")
    ] = None,
) -> None:
    """Show the vehicle live in Foxglove or Lichtblick, and fly it from there, until Ctrl-C.

    Prints the address to open there, and the file of a layout to import. With --control the address
    has a token, that of QUADCTL_FOXGLOVE_TOKEN or a new one; a client without it only watches.
    Pages of other sites than this machine's, Foxglove's and --origin may not connect.

    Example: quadctl bridge foxglove --control
    """
    require("foxglove")
    _check(host, port, cert, key)
    token = (os.environ.get(VARIABLE) or secrets.token_urlsafe(16)) if control else ""
    if 0 < len(token) < _SHORTEST:
        raise UsageError(f"{VARIABLE} is too short", f"at least {_SHORTEST} characters")
    os.environ[VARIABLE] = token
    address = f"{'wss' if cert else 'ws'}://{url_host(host)}:{port}/"
    words = ["--port", str(port), "--host", host]
    words += ["--cert", str(cert)] if cert else []
    words += ["--key", str(key)] if key else []
    words += [word for site in origin or () for word in ("--origin", site.rstrip("/"))]
    facts = {
        "address": f"{address}?token={quote(token, safe='')}" if control else address,
        "watch": address,
    }
    become(
        "foxglove",
        options,
        words,
        {**facts, "layout": str(LAYOUT)},
        f"open the connection {facts['address']} in Foxglove or Lichtblick",
        f"import the layout {LAYOUT}",
        f"without the token, {address} may only watch" if control else "clients may only watch",
    )


def _check(host: str, port: int, cert: Path | None, key: Path | None) -> None:
    """Raise UsageError for a wrong address, Invalid for a wrong certificate, QuadctlError for a taken port."""
    if not 0 < port <= _MOST:
        raise UsageError(f"--port {port}: there is no such port", f"1 to {_MOST}")
    check_listener(host, encrypted=cert is not None)
    if key and not cert:
        raise UsageError("--key without --cert", "add --cert FILE")
    if cert:
        try:
            ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(cert, key)
        except OSError as error:  # SSLError, too
            raise Invalid(
                f"--cert {cert}: {error.strerror or error}", "a PEM certificate, and its key"
            ) from error
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        # As the server: a port whose last connections have just ended is free.
        if os.name == "posix":
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            other = port + 1 if port < _MOST else 8765
            raise QuadctlError(
                f"port {port} cannot be opened: {error.strerror}",
                f"end the program that has it, or choose another: --port {other}",
            ) from error
