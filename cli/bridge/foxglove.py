"""`bridge foxglove`: the process of the bridge, in the place of the command."""

import socket
from pathlib import Path
from typing import Annotated

from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.runtime.errors import QuadctlError, UsageError

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
"""Layout with the scene, plots, the state and buttons of the vehicle `uav`."""
_HOST = "127.0.0.1"
_MOST = 65535


def foxglove(
    options: Options,
    port: Annotated[int, Option("Port of the server, on this machine only.", metavar="N")] = 8765,
    control: Annotated[
        bool, Option("Let clients fly the vehicle and set parameters, not only look.")
    ] = False,
) -> None:
    """Show the vehicle live in Foxglove or Lichtblick, and fly it from there, until Ctrl-C.

    Prints the address to open there, and the file of a layout to import. Without --control a
    client sees everything and changes nothing.

    Example: quadctl bridge foxglove --control
    """
    require("foxglove")
    _check(port)
    address = f"ws://{_HOST}:{port}"
    words = ["--port", str(port), *(["--control"] if control else [])]
    become(
        "foxglove",
        options,
        words,
        {"address": address, "layout": str(LAYOUT), "control": control},
        f"open the connection {address} in Foxglove or Lichtblick",
        f"import the layout {LAYOUT}",
        "clients may fly the vehicle" if control else "clients may only look: see --control",
    )


def _check(port: int) -> None:
    """Raise UsageError for a number that is no port, QuadctlError if another program has it."""
    if not 0 < port <= _MOST:
        raise UsageError(f"--port {port}: there is no such port", f"1 to {_MOST}")
    with socket.socket() as probe:
        # As the server: a port whose last connections have just ended is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError as error:
            other = port + 1 if port < _MOST else 8765
            raise QuadctlError(
                f"port {port} cannot be opened: {error.strerror}",
                f"end the program that has it, or choose another: --port {other}",
            ) from error
