"""Machines on a network as network namespaces, each with its own addresses and links only."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.support import abilities
from tests.support.running import DEADLINE

_LOOPBACK = (("link", "set", "lo", "up"),)


def tool(name: str) -> str:
    """Return the path of a network tool; the test needs "ip"."""
    found = shutil.which(name, path=abilities.SEARCH)
    assert found is not None
    return found


class Machine:
    """Network namespace, kept open by a process that sleeps in it."""

    def __init__(self, inside: "Machine | None" = None) -> None:
        """Create the namespace, with the network privileges of the machine `inside` if given."""
        own = [] if inside else abilities.as_root()
        before: list[str] = inside.enter if inside else []
        self._holder = subprocess.Popen(
            [*before, tool("unshare"), *own, "--net", sys.executable, "-c", _HOLD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None
        self.pid = int(self._holder.stdout.readline())
        as_user = [] if os.geteuid() == 0 else ["--user", "--preserve-credentials"]
        self.enter: list[str] = [tool("nsenter"), f"--target={self.pid}", *as_user, "--net"]
        for command in _LOOPBACK:
            self.ip(*command)

    def ip(self, *words: str) -> str:
        """Run `ip` in the namespace."""
        return subprocess.run(
            [*self.enter, tool("ip"), *words], check=True, capture_output=True, text=True
        ).stdout

    def address(self, link: str, address: str) -> None:
        """Bring a link up with an address, e.g. 10.7.1.2/24."""
        self.ip("address", "add", address, "dev", link)
        self.ip("link", "set", link, "up")

    def sockets(self) -> list[str]:
        """Return all listening TCP and UDP sockets, IPv4 and IPv6, e.g. `tcp 0100007F:1D17`."""
        found = []
        for table, listening in (("tcp", "0A"), ("tcp6", "0A"), ("udp", "07"), ("udp6", "07")):
            lines = Path(f"/proc/{self.pid}/net/{table}").read_text(encoding="utf-8").splitlines()
            rows = [line.split() for line in lines[1:]]
            found += [f"{table} {row[1]}" for row in rows if row[3] == listening]
        return found

    def end(self) -> None:
        """Remove the namespace with all its links."""
        self._holder.communicate(timeout=DEADLINE)


_HOLD = "import os, sys; print(os.getpid(), flush=True); sys.stdin.read()"


def connect(one: Machine, other: Machine, names: tuple[str, str]) -> None:
    """Connect two machines with a cable whose ends have these names."""
    one.ip("link", "add", names[0], "type", "veth", "peer", "name", names[1])
    one.ip("link", "set", names[1], "netns", str(other.pid))


@contextmanager
def three_machines() -> Iterator[tuple[Machine, Machine, Machine]]:
    """Set up vehicle, router and operator; vehicle and operator reach only the router."""
    with ExitStack() as held:
        router = Machine()
        held.callback(router.end)
        vehicle, operator = Machine(router), Machine(router)
        held.callback(vehicle.end)
        held.callback(operator.end)
        for machine, link, net in ((vehicle, "v0", "10.7.1"), (operator, "o0", "10.7.2")):
            connect(router, machine, (f"r{link}", link))
            router.address(f"r{link}", f"{net}.1/24")
            machine.address(link, f"{net}.2/24")
        yield vehicle, router, operator


class Port(NamedTuple):
    """Port of a bridge, with the machine at the other end of the cable."""

    machine: Machine
    bridge: Machine
    link: str

    @contextmanager
    def unplugged(self) -> Iterator[None]:
        """Unplug the cable during the block."""
        self.bridge.ip("link", "set", self.link, "down")
        try:
            yield
        finally:
            self.bridge.ip("link", "set", self.link, "up")


@contextmanager
def one_network(count: int) -> Iterator[tuple[Machine, list[Port]]]:
    """Set up a machine at 10.7.1.1 and `count` others from 10.7.1.2, all on its bridge."""
    with ExitStack() as held:
        first, ports = Machine(), []
        held.callback(first.end)
        first.ip("link", "add", "name", "room", "type", "bridge")
        first.address("room", "10.7.1.1/24")
        for number in range(count):
            machine = Machine(first)
            held.callback(machine.end)
            connect(first, machine, (f"port{number}", "eth"))
            first.ip("link", "set", f"port{number}", "master", "room", "up")
            machine.address("eth", f"10.7.1.{2 + number}/24")
            ports.append(Port(machine, first, f"port{number}"))
        yield first, ports
