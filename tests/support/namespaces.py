"""Machines on a network, as network namespaces: each with its own addresses and no way but its links."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

_PATH = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin", "/usr/bin", "/bin"))
"""Where `ip` stands is on root's path alone."""
_LOOPBACK = (("link", "set", "lo", "up"),)


def tool(name: str) -> str:
    """The full path of a tool that makes networks; fails the test where it is missing."""
    found = shutil.which(name, path=_PATH)
    if found is None:
        pytest.fail(f"{name} is not there: apt install iproute2 util-linux")
    return found


class Machine:
    """A network namespace, kept by a process that sleeps in it."""

    def __init__(self, inside: "Machine | None" = None) -> None:
        """`inside` is a machine whose rights over networks the new one shares."""
        own = [] if os.geteuid() == 0 or inside else ["--user", "--map-root-user"]
        before: list[str] = inside.enter if inside else []
        self._holder = subprocess.Popen(
            [*before, tool("unshare"), *own, "--net", sys.executable, "-c", _HOLD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None
        said = self._holder.stdout.readline()
        if not said:
            pytest.fail(
                "no network namespace can be made here: it takes root, or user namespaces"
                " (sysctl kernel.unprivileged_userns_clone=1)"
            )
        self.pid = int(said)
        as_user = [] if os.geteuid() == 0 else ["--user", "--preserve-credentials"]
        self.enter: list[str] = [tool("nsenter"), f"--target={self.pid}", *as_user, "--net"]
        for command in _LOOPBACK:
            self.ip(*command)

    def ip(self, *words: str) -> str:
        """Run `ip` in it."""
        return subprocess.run(
            [*self.enter, tool("ip"), *words], check=True, capture_output=True, text=True
        ).stdout

    def address(self, link: str, address: str) -> None:
        """Bring a link up with an address, as 10.7.1.2/24."""
        self.ip("address", "add", address, "dev", link)
        self.ip("link", "set", link, "up")

    def sockets(self) -> list[str]:
        """All that listens in it, TCP and UDP over both kinds of IP, as `tcp 0100007F:1D17`."""
        found = []
        for table, listening in (("tcp", "0A"), ("tcp6", "0A"), ("udp", "07"), ("udp6", "07")):
            lines = Path(f"/proc/{self.pid}/net/{table}").read_text(encoding="utf-8").splitlines()
            rows = [line.split() for line in lines[1:]]
            found += [f"{table} {row[1]}" for row in rows if row[3] == listening]
        return found

    def end(self) -> None:
        """Let it go, with all its links."""
        self._holder.communicate(timeout=5)


_HOLD = "import os, sys; print(os.getpid(), flush=True); sys.stdin.read()"


def connect(one: Machine, other: Machine, names: tuple[str, str]) -> None:
    """Lay a cable between two machines, its ends named."""
    one.ip("link", "add", names[0], "type", "veth", "peer", "name", names[1])
    one.ip("link", "set", names[1], "netns", str(other.pid))


@contextmanager
def three_machines() -> Iterator[tuple[Machine, Machine, Machine]]:
    """A vehicle, a router between, and an operator, who see the router and not one another."""
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
    """Where a machine's cable goes into the other's bridge."""

    machine: Machine
    bridge: Machine
    link: str

    @contextmanager
    def unplugged(self) -> Iterator[None]:
        """With the cable pulled out."""
        self.bridge.ip("link", "set", self.link, "down")
        try:
            yield
        finally:
            self.bridge.ip("link", "set", self.link, "up")


@contextmanager
def one_network(count: int) -> Iterator[tuple[Machine, list[Port]]]:
    """A machine at 10.7.1.1, and so many others at 10.7.1.2 and on, all on its bridge."""
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
