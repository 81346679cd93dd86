"""`console`: the vehicle on a web page."""

import importlib.util
import secrets
import webbrowser
from ipaddress import ip_address
from typing import Annotated

from msgspec import structs

from cli import bus, output
from cli.console.address import bound, urls
from cli.declare import Opt
from cli.options import Options
from services.runtime import realm, vehicles
from services.runtime.errors import QuadctlError, Unreachable, UsageError

_PORT = 8470


def console(
    options: Options,
    port: Annotated[
        int | None, Opt(f"Where to serve (default: {_PORT}, or a free one where that is taken).")
    ] = None,
    browse: Annotated[bool, Opt("Open the page in a browser.", ("--open",))] = False,
    host: Annotated[str, Opt("The address to listen on.")] = "127.0.0.1",
    insecure: Annotated[
        bool, Opt("Let other machines in: what they send and see is not encrypted.")
    ] = False,
) -> None:
    """Fly from a web page: the vehicle in its cage, its readings, processes and parameters.

    The first address printed may control, by its token; without the token the page only watches.

    Example: quadctl console --open
    """
    if importlib.util.find_spec("nicegui") is None:
        raise QuadctlError(
            "the console needs NiceGUI, which is not installed",
            "pip install 'quadctl[console]', in the environment of quadctl",
        )
    _check(host, insecure=insecure)
    # Where nothing runs, or does not answer, that is told now and not on a page.
    with bus.connect(structs.replace(options, named=options.named or realm.DEFAULT)):
        there = vehicles.of(options.realm, options.connect, options.timeout)
    first = options.named or there[0]
    if first not in there:
        raise Unreachable(f"there is no vehicle {first}", f"there is {realm.listed(there)}")
    from cli.console.server import serve

    listening = bound(host, _PORT if port is None else port, exactly=port is not None)
    token = secrets.token_urlsafe(16)
    control, watch = urls(listening, token)
    if options.json:
        output.document({"url": control, "watch": watch, "vehicles": there})
    else:
        output.line(f"control: {control}")
        output.line(f"watch:   {watch}")
        output.note("Ctrl-C ends the console; the vehicle goes on")
    if insecure:
        output.note(
            "warning: other machines may watch, and who sees this address or reads the network's"
            " traffic, which is not encrypted, may fly"
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
            f"--host {host} lets other machines in: they could watch, and whoever reads the traffic,"
            " which is not encrypted, could fly",
            "where that is meant, add --insecure; else tunnel: ssh -L 8470:127.0.0.1:8470 HOST",
        )
