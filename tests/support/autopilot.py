"""Our safety before an autopilot: a second run, as a PX4 behind our bridge, and its pilot."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import dist
from typing import NamedTuple

from msgspec.structs import astuple
from pymavlink.dialects.v20 import common as mavlink

import quadctl
from quadctl.services.runtime.errors import QuadctlError
from tests.support.mavlink import ORIGIN, GroundStation, bridge, near
from tests.support.relay import Relay
from tests.support.running import eventually

OFFBOARD, HOLD = (6, 0), (4, 3)
INNER = {f"safety.virtual_cage.{axis}": 20.0 for axis in "xyz"}


class Rig(NamedTuple):
    """Run of our safety, and of the vehicle that is its autopilot, with the pilot's station."""

    ours: quadctl.Run
    theirs: quadctl.Run
    pilot: GroundStation
    relay: Relay

    def fly_by(self, mode: tuple[int, int]) -> int:
        """Change the mode, like the pilot."""
        return self.pilot.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)

    def give(self) -> None:
        """Give the vehicle to our safety, once the autopilot takes the mode, and wait for it."""
        eventually(lambda: self.fly_by(OFFBOARD) == 0)
        eventually(self.is_ours)
        self.ours.vehicle.settle()

    def is_ours(self) -> bool:
        """Return whether our safety flies, by the last line about it in the adapter's log."""
        return "safety flies" in "".join(self.told[-1:])

    @property
    def told(self) -> list[str]:
        """Return the lines of the adapter's log about who flies."""
        lines = self.ours.logs()["dynamics"]
        return [each for each in lines if "safety flies" in each or "no poses" in each]

    def refusal(self) -> str:
        """Return why our safety refuses a goal, empty if it accepts it."""
        try:
            self.ours.vehicle.goto(0, 0, 1, wait=False)
        except QuadctlError as problem:
            return problem.message
        return ""

    def quadctl(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command on our run."""
        command = [sys.executable, "-m", "quadctl", *words, "--realm", self.ours.realm]
        return subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)

    def pid(self, node: str) -> int:
        """Return the process of a node of our run."""
        nodes = json.loads(self.quadctl("status", "--json").stdout)["nodes"]
        return next(each["pid"] for each in nodes if each["name"] == node)

    @property
    def place(self) -> tuple[float, ...]:
        """Return where the vehicle truly is, m."""
        return astuple(self.theirs.vehicle.pose().position)

    def is_near(self, place: tuple[float, float, float]) -> bool:
        """Return whether the vehicle truly is near a place, m."""
        return dist(self.place, place) < 0.1


@contextmanager
def rig(
    *options: str, speed: float = 1.5, loss: float = 0.0, delay: float = 0.0, jitter: float = 0.0
) -> Iterator[Rig]:
    """Run both, with the relay's loss, delay and jitter (s) between them; in the air, not given yet.

    The vehicle flies at a speed, m/s: so slowly that there is time to do something in a flight.
    """
    port = free_udp_port()
    command = command_of(port, *options)
    with (
        quadctl.launch(params=INNER | {"dynamics.control.max_speed": speed}) as theirs,
        GroundStation() as pilot,
        Relay(port, pilot.port, loss=loss, delay=delay, jitter=jitter) as relay,
        bridge(theirs.realm, relay.port),
        quadctl.launch(processes={"dynamics": command}, params={"safety.takeoff": 0}) as ours,
    ):
        pilot.wait("HEARTBEAT")
        eventually(lambda: near(theirs, (0, 0, 1)))
        yield Rig(ours, theirs, pilot, relay)


def command_of(port: int, *options: str) -> str:
    """Return the command of an adapter that listens on a port."""
    words = f"--connect udpin:127.0.0.1:{port} --origin {ORIGIN.latitude} {ORIGIN.longitude} 488"
    return " ".join((sys.executable, "-m quadctl autopilot", words, *options))


def free_udp_port() -> int:
    """Return a port of this machine that nobody listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])
