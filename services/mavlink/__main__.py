"""Process of the bridge to MAVLink: each vehicle is a system of its own, behind one socket.

python -P -m quadctl.services.mavlink [--to udpout:127.0.0.1:14550] [--origin LAT LON ALT]
    [--signing-key FILE]

It holds no safety logic: a goal goes the way of our own services, and is refused by them.
"""

import argparse
import contextlib
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import Struct

from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    CalibrateRequest,
    GetParamsRequest,
    GotoRequest,
    GotoResponse,
    HoldRequest,
    SetParamsRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    POSE_SLOW,
    STATE,
    TOGGLE_CAGE,
    ZONES,
    Service,
    get_params,
    set_params,
)
from quadctl.services.mavlink.geo import Origin
from quadctl.services.mavlink.link import Link, address_of, key_of
from quadctl.services.mavlink.system import System
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import QuadctlError, Refused
from quadctl.services.runtime.node import Node

NAME = "mavlink"
_NODES = ("dynamics", "pressure", "safety")
_TIMEOUT = 3.0
"""Seconds that a call to one of our services may take."""


def main() -> None:
    """Parse the options that only the bridge has, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--to", default="udpout:127.0.0.1:14550")
    parser.add_argument("--origin", nargs=3, type=float, default=(47.397742, 8.545594, 488.0))
    parser.add_argument("--signing-key", type=Path)
    options, sys.argv[1:] = parser.parse_known_args()
    start(NAME, partial(run, Bridge(options)))


def run(bridge: "Bridge", node: Node, _params: Params) -> None:
    """Bridge one vehicle until stopped."""
    system = bridge.add(node)
    node.listen(POSE_SLOW, system.see)
    node.listen(STATE, system.see)
    node.listen(ZONES, system.see)
    with contextlib.suppress(QuadctlError):  # what safety publishes later comes by itself
        system.see(node.latest(ZONES, _TIMEOUT))
    node.spin()


class Bridge:
    """Systems of all vehicles, and the link that they share."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._systems: dict[int, System] = {}
        self._link: Link | None = None

    def add(self, node: Node) -> System:
        """Return the system of a vehicle; the first one opens the link."""
        given = self._options
        if self._link is None:
            key = key_of(given.signing_key) if given.signing_key else None
            self._link = Link(address_of(given.to), key)
            receive = partial(self._link.receive, self._take, self._tick)
            threading.Thread(target=receive, daemon=True).start()
            node.log.info("sending to %s", given.to)
        number = len(self._systems) + 1
        system = System(
            number, Vehicle(node), Origin(*given.origin), self._link.sender(number), node.log
        )
        self._systems[number] = system
        return system

    def _take(self, message: Any) -> None:
        # A message without a target is for all.
        target = getattr(message, "target_system", 0)
        now = time.monotonic()
        for number, system in tuple(self._systems.items()):
            if target in {0, number}:
                system.take(message, now)

    def _tick(self) -> None:
        now = time.monotonic()
        for system in tuple(self._systems.values()):
            system.tick(now)


class Vehicle:
    """Services of one vehicle; all methods block."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def goto(self, request: GotoRequest) -> GotoResponse:
        """Request a goal from safety."""
        reply: GotoResponse = self._call(GOTO, request)
        return reply

    def hold(self) -> None:
        """Stop the vehicle."""
        self._call(HOLD, HoldRequest())

    def toggle_cage(self, *, on: bool) -> None:
        """Turn the cage on or off."""
        self._call(TOGGLE_CAGE, ToggleCageRequest(on))

    def calibrate(self) -> None:
        """Zero the barometer."""
        self._call(CALIBRATE, CalibrateRequest(zero=True))

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the nodes that answer, by dotted name."""
        values: dict[str, Any] = {}
        for node in _NODES:
            with contextlib.suppress(QuadctlError):
                values |= self._call(get_params(node), GetParamsRequest([])).values
        return values

    def set_parameters(self, values: dict[str, Any]) -> None:
        """Set parameters of one node, all or none; raise Refused with its reason."""
        node = next(iter(values)).partition(".")[0]
        reply = self._call(set_params(node), SetParamsRequest(values))
        if not reply.success:
            raise Refused(reply.reason)

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        return self._node.client(service).call(request, _TIMEOUT)


if __name__ == "__main__":
    main()
