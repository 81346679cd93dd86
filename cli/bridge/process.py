"""Start of a bridge's process, in the place of its command."""

import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from typing import Any, NoReturn

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options, listed_vehicles, with_any_vehicle
from quadctl.schemas.roles import BRIDGES
from quadctl.services.bridges.options import BridgeOptions
from quadctl.services.runtime.errors import QuadctlError, UsageError

_NEEDS = {"foxglove": "websockets", "mavlink": "pymavlink", "ros2": "rosbags"}
"""Packages that a bridge needs beyond quadctl's own."""


def require(bridge: str) -> None:
    """Raise UsageError for an unknown bridge, QuadctlError if its extra is not installed."""
    if bridge not in BRIDGES:
        raise UsageError(f"there is no bridge {bridge}", f"one of {', '.join(BRIDGES)}")
    if find_spec(_NEEDS[bridge]) is None:
        raise QuadctlError(
            f"the bridge {bridge} needs the package {_NEEDS[bridge]}, which is not installed",
            f"`pip install 'quadctl[{bridge}]'`, into the same environment",
        )


def become(
    bridge: str, options: Options, given: BridgeOptions, facts: dict[str, Any], *remarks: str
) -> NoReturn:
    """Run a bridge with its options; print the facts with --json, else remarks.

    Raises Unreachable without a hub, and as `check` of the options does. A supervisor's bridge waits
    for the hub, and has its vehicles in the environment.
    """
    require(bridge)
    given.check()
    if os.environ.get("QUADCTL_SUPERVISED"):
        run_instead(command_of(bridge, options, given))
    vehicles = listed_vehicles(options)
    options = with_any_vehicle(options)
    with context.connect(options) as client:
        # Fail here, with a better message than the bridge's, without a hub.
        client.flush()
    words = ["--connect", options.connect] if options.connect else []
    words += [word for vehicle in vehicles for word in ("--vehicle", vehicle)]
    if options.json:
        output.document({**facts, "vehicles": vehicles})
    else:
        for remark in (*remarks, "Ctrl-C ends the bridge; the vehicle keeps flying"):
            output.note(remark)
    run_instead([*command_of(bridge, options, given), *words])


def command_of(module: str, options: Options, given: BridgeOptions) -> list[str]:
    """Return the command line of a module of the bridges, run by our own interpreter."""
    text = msgspec.json.encode(given).decode()
    command = [sys.executable, "-P", "-m", f"quadctl.services.bridges.{module}"]
    return [*command, "--options", text, "--realm", options.realm]


def run_instead(command: list[str]) -> NoReturn:
    """Run a command line in the place of this command."""
    sys.stdout.flush()
    if os.name == "nt":  # where execv would return at once, and leave it in the background
        sys.exit(subprocess.call(command))
    # A Ctrl-C would get lost as the command ends, or in the module's imports: it waits for its `start`.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Threads of Zenoh still take one, and Python's handler would note it for an interpreter that goes.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # One process: whoever ends the command ends it.
    os.execv(command[0], command)  # noqa: S606 - our own interpreter, no shell
