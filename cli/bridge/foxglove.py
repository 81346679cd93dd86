"""`bridge foxglove`: the process of the bridge, in the place of the command."""

from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.bridges.options import FoxgloveOptions, set_token
from quadctl.services.runtime.security.endpoints import url_host

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
"""Layout with the scene, plots, the state and buttons of the vehicle `uav`."""


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
    origins = tuple(site.rstrip("/") for site in origin or ())
    given = FoxgloveOptions(port, host, str(cert or ""), str(key or ""), origins)
    token = set_token(control=control)
    watch = f"{'wss' if cert else 'ws'}://{url_host(host)}:{port}/"
    address = f"{watch}?token={quote(token, safe='')}" if token else watch
    become(
        "foxglove",
        options,
        given,
        {"address": address, "watch": watch, "layout": str(LAYOUT)},
        f"open the connection {address} in Foxglove or Lichtblick",
        f"import the layout {LAYOUT}",
        f"without the token, {watch} may only watch" if control else "clients may only watch",
    )
