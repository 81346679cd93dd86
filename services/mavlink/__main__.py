"""Process of the bridge to MAVLink: one socket, and a system for each vehicle.

python -P -m quadctl.services.mavlink [--to udpout:127.0.0.1:14550] [--origin LAT LON ALT]
    [--signing-key FILE]

It holds no safety logic: a goal goes the way of our own services, and is refused by them.
"""

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import origin_of
from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    CalibrateRequest,
    GotoRequest,
    GotoResponse,
    HoldRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    POSE,
    POSE_SLOW,
    STATE,
    TOGGLE_CAGE,
    Service,
)
from quadctl.services.mavlink.link import MavlinkLink
from quadctl.services.mavlink.system import MavlinkSystem
from quadctl.services.runtime.bus.pubsub import Subscription
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.remote import RemoteParams
from quadctl.services.runtime.security import bridge_access

NAME = "mavlink"
_OURS = {0, mavlink.MAV_COMP_ID_AUTOPILOT1}
"""Components that a message for us names."""
_MOST = 254
"""Largest number of a system; ground stations have 255."""
_TIMEOUT = 3.0
"""Seconds that a call to one of our services may take."""


def main() -> None:
    """Parse the options that only the bridge has, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--to", default="udpout:127.0.0.1:14550")
    parser.add_argument("--origin", nargs=3, type=float, default=())
    parser.add_argument("--signing-key", type=Path)
    options, sys.argv[1:] = parser.parse_known_args()
    start(NAME, partial(run, MavlinkBridge(options)), keeps_time=True)


def run(bridge: "MavlinkBridge", node: Node, _params: Params) -> None:
    """Bridge one vehicle until stopped."""
    if node.is_first:
        bridge.open(node)
    system = bridge.add(node)
    node.listen(POSE_SLOW, system.see)
    node.listen(STATE, system.see)
    system.learn_start()
    node.spin()


class MavlinkBridge:
    """Systems of all vehicles, and the link that they share."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._systems: dict[int, MavlinkSystem] = {}

    def open(self, node: Node) -> None:
        """Open the link; raise QuadctlError for a wrong address or key."""
        given = self._options
        address = bridge_access.address_of(given.to)
        bridge_access.check_peer(address, f"--to {given.to}", signed=given.signing_key is not None)
        key = bridge_access.key_of(given.signing_key) if given.signing_key else None
        self._link = MavlinkLink(address, key, node.log)
        self._origin = origin_of(given.origin)
        self._link.start(self._take, self._tick, node.post)
        node.log.info("sending to %s", given.to)

    def add(self, node: Node) -> MavlinkSystem:
        """Return the system of a vehicle; raise UsageError for one vehicle too many."""
        number = len(self._systems) + 1
        if number > _MOST:
            raise UsageError(f"MAVLink has numbers for {_MOST} vehicles", "name some by --vehicle")
        send = self._link.sender(number)
        services = NodeServices(node)
        system = MavlinkSystem(services, self._origin, send, node.log)
        self._systems[number] = services.system = system
        return system

    def _take(self, message: Any) -> None:
        # A message without a target is for all.
        target = getattr(message, "target_system", 0)
        if getattr(message, "target_component", 0) in _OURS:
            now = time.monotonic()
            for number, system in tuple(self._systems.items()):
                if target in {0, number}:
                    system.take(message, now)

    def _tick(self) -> None:
        now = time.monotonic()
        for system in tuple(self._systems.values()):
            system.tick(now)


class NodeServices:
    """Services of one vehicle, called by the bridge's node of it; all methods block."""

    system: MavlinkSystem

    def __init__(self, node: Node) -> None:
        self._node, self.parameters = node, RemoteParams(self._call, node.endpoints)
        self._poses: Subscription[Any] | None = None

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

    def watch(self, *, every_pose: bool) -> None:
        """Take all poses, or only the slow ones."""
        self._node.post(partial(self._listen, every_pose=every_pose))

    def _listen(self, *, every_pose: bool) -> None:
        if not every_pose and self._poses is not None:
            self._node.unlisten(self._poses)
            self._poses = None
        elif every_pose and self._poses is None:
            self._poses = self._node.listen(POSE, self.system.see)

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        return self._node.client(service).call(request, _TIMEOUT)


if __name__ == "__main__":
    main()
