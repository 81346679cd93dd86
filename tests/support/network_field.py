"""Vehicle, router and operator on three machines, with a fleet's keys."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.support.intruder import sent
from tests.support.lab import Lab, private_lab
from tests.support.namespaces import Machine, three_machines
from tests.support.running import Done, Foreground, eventually

ROUTER = "10.7.1.1"
"""Address of the router on the vehicle's side."""
AT = "10.7.2.1"
"""Address of the router on the operator's side."""
TLS, QUIC, PLAIN = f"tls/{AT}:7447", f"quic/{AT}:7447", f"tcp/{AT}:7448"
IDENTITIES = (
    "hub router --host 10.7.1.1 --host 10.7.2.1",
    "hub uav --vehicle uav",
    "operator anna",
    "observer eve",
    "student una --vehicle uav",
    "student bob --vehicle uav9",
    "operator rob",
)


class Field:
    """Three labs and the folder of their keys."""

    def __init__(self, machines: tuple[Machine, Machine, Machine], labs: list[Lab]) -> None:
        self.machines, (self.vehicle, self.router, self.operator) = machines, labs
        self.keys = self.operator.folder / "keys"

    def issue(self, line: str) -> Path:
        """Issue a certificate, and return its folder."""
        issued = self.operator.quadctl("keys", "issue", *line.split(), "--json")
        assert issued.code == 0, issued.err
        return self.operator.folder / str(issued.json["folder"])

    def go_up(self) -> None:
        """Start the router's hub, and a vehicle whose hub connects to it."""
        assert self.operator.quadctl("keys", "init").code == 0
        for line in IDENTITIES:
            self.issue(line)
        up = self.router.quadctl(
            *("hub", "-d", "--listen", "tls/0.0.0.0:7447", "--listen", "quic/0.0.0.0:7447"),
            *("--identity", self.keys / "router"),
        )
        assert up.code == 0, up.err
        up = self.vehicle.quadctl(
            *("up", "-d", "--connect", f"tls/{ROUTER}:7447", "--identity", self.keys / "uav")
        )
        assert up.code == 0, up.err
        eventually(lambda: self.ask("state").code == 0)

    def ask(self, line: str, identity: str = "anna", *, at: str = TLS, json: bool = False) -> Done:
        """Run a command on the operator's machine with an identity."""
        words = line.split() + (["--json"] if json else [])
        return self.operator.quadctl(*words, "--connect", at, "--identity", self.keys / identity)

    def intrude(self, identity: str) -> dict[str, list[str]]:
        """Run an intruder with a certificate, and return the keys that it received."""
        return sent(self.machines[2].enter, TLS, self.keys / identity)

    def sniffed(self, file: Path) -> AbstractContextManager[None]:
        """Write all traffic through the router to a file."""
        return self._beside("sniff.py", file)

    def impersonated_hub(self, endpoint: str, identity: str) -> AbstractContextManager[None]:
        """Impersonate the hub on the router's machine with an identity."""
        return self._beside("posing.py", endpoint, self.keys / identity)

    @contextmanager
    def _beside(self, script: str, *words: object) -> Iterator[None]:
        path = str(Path(__file__).with_name(script))
        process = subprocess.Popen(
            [*self.machines[1].enter, sys.executable, path, *map(str, words)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "listening\n"
        try:
            yield
        finally:
            process.kill()
            process.communicate()

    def started(self, line: str, identity: str) -> Foreground:
        """Start a command with an identity beside the test."""
        words = [*line.split(), "--connect", TLS, "--identity", str(self.keys / identity)]
        return self.operator.spawn(*self.operator.command(*words))

    def node(self, name: str, vehicle: str, identity: str) -> Foreground:
        """Start a node of a vehicle on the operator's machine."""
        return self.operator.spawn(
            *(*self.machines[2].enter, sys.executable, "-P", "-m", f"quadctl.services.{name}"),
            *("--vehicle", vehicle, "--connect", TLS, "--identity", str(self.keys / identity)),
        )

    def copied_identity(self, identity: str) -> str:
        """Copy an identity out of reach of `revoke`, and return the copy's name."""
        shutil.copytree(self.keys / identity, self.keys / f"{identity}-kept")
        return f"{identity}-kept"


def touched(lab: Lab) -> tuple[Any, ...]:
    """Return the values that change with any call to the vehicle."""
    with lab.bare() as bare:
        state = bare.state()
        ranges = bare.call("safety/get_params", names=["safety.acceptance_range"]).value
    return state["request"], state["cage_on"], state["boot"], ranges["values"]


@contextmanager
def field() -> Iterator[Field]:
    """Start everything, and stop it at the end."""
    with ExitStack() as held:
        machines = held.enter_context(three_machines())
        labs = [held.enter_context(private_lab(machine.enter)) for machine in machines]
        made = Field(machines, labs)
        made.go_up()
        yield made
