"""Processes of the bridges to other networks, started by their commands."""

import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from tests.support.lab import Lab
from tests.support.running import DEADLINE, Foreground, eventually


@contextmanager
def bridge(
    realm: str, name: str, *options: str, environment: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """Bridge a run until the end of the block; the bridge may not be ready at its begin."""
    command = [sys.executable, "-m", "quadctl", "bridge", name, "--realm", realm, *options]
    process = subprocess.Popen(command, env=environment)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(DEADLINE)


def without(package: str, bridge: str) -> subprocess.CompletedProcess[str]:
    """Start a bridge where a package is not installed."""
    hide = "import importlib.util as u; f = u.find_spec;"
    hide += f" u.find_spec = lambda name, *a: None if name == '{package}' else f(name, *a);"
    line = f"import sys; sys.modules['{package}'] = None; sys.argv[1:] = ['bridge', '{bridge}'];"
    line += "from quadctl.cli.main import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", hide + line],
        check=False,
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )


@contextmanager
def bridged(lab: Lab, name: str, *options: str) -> Iterator[Foreground]:
    """Bridge the run of a lab from when the bridge's node is up until the end of the block."""
    process = lab.spawn(*lab.command("bridge", name, *options))
    try:
        eventually(
            lambda: name in {node["name"] for node in lab.quadctl("node", "list", "--json").json}
        )
        yield process
    finally:
        if not process.ended:
            process.send(signal.SIGTERM)
            assert process.wait() == 0, process.log
