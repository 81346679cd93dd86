"""Start of a bridge's process, in the place of its command."""

import os
import signal
import subprocess
import sys
from typing import Any, NoReturn

from quadctl.cli import context, output
from quadctl.cli.context import Options, listed_vehicles, with_any_vehicle


def become(
    bridge: str, options: Options, words: list[str], facts: dict[str, Any], *remarks: str
) -> NoReturn:
    """Run a bridge with the words of its own options; print the facts with --json, else remarks.

    Raises Unreachable without a hub.
    """
    vehicles = listed_vehicles(options)
    options = with_any_vehicle(options)
    with context.connect(options) as client:
        # Fail here, with a better message than the bridge's, without a hub.
        client.flush()
    command = [sys.executable, "-P", "-m", f"quadctl.services.{bridge}", *words]
    command += ["--realm", options.realm]
    command += ["--connect", options.connect] if options.connect else []
    command += [word for vehicle in vehicles for word in ("--vehicle", vehicle)]
    if options.json:
        output.document({**facts, "vehicles": vehicles})
    else:
        for remark in (*remarks, "Ctrl-C ends the bridge; the vehicle keeps flying"):
            output.note(remark)
    run_instead(command)


def run_instead(command: list[str]) -> NoReturn:
    """Run a module by our own interpreter, in the place of this command."""
    sys.stdout.flush()
    if os.name == "nt":  # where execv would return at once, and leave it in the background
        sys.exit(subprocess.call(command))
    # A Ctrl-C would get lost as the command ends, or in the module's imports: it waits for its `start`.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Threads of Zenoh still take one, and Python's handler would note it for an interpreter that goes.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # One process: whoever ends the command ends it.
    os.execv(sys.executable, command)  # noqa: S606 - our own interpreter, no shell
