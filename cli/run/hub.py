"""`hub`: a hub alone."""

import os
from pathlib import Path

from cli.options import Options
from cli.run.up import Detach, Insecure, Listen, begin, reached
from services.runtime.params import load
from services.runtime.process_table import NODES
from services.runtime.realm import HUB_ALONE
from services.runtime.supervisor.launch import Launch


def hub(
    options: Options,
    detach: Detach = False,
    listen: Listen = None,
    insecure: Insecure = False,
) -> None:
    """Run a hub without a vehicle, for others to meet at; with --connect it joins that other one.

    Example: quadctl hub --listen tls/0.0.0.0:7447 --identity keys/field
    """
    # A hub's nodes stand beside the vehicles' under a name, which two hubs must not share.
    name = options.named or f"{HUB_ALONE}{os.urandom(2).hex()}"
    parameters = load.load_vehicles(None, reached(listen, options.connect), [name])
    without = [node for node in NODES if node != "hub"]
    launch = Launch(options.realm, parameters, without, str(Path.cwd()), insecure=insecure)
    begin(launch, options, detach=detach)
