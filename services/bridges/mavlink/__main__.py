"""Process of the bridge to MAVLink: one socket, and a system for each vehicle."""

import time
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE, POSE_SLOW, STATE
from quadctl.services.bridges.base import BridgedVehicle, run_bridge
from quadctl.services.bridges.mavlink.link import MavlinkLink
from quadctl.services.bridges.mavlink.system import MavlinkSystem
from quadctl.services.bridges.options import MavlinkOptions
from quadctl.services.runtime.bus.pubsub import Subscription
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.node import Node

_OURS = {0, mavlink.MAV_COMP_ID_AUTOPILOT1}
"""Components that a message for us names."""
_MOST = 254
"""Largest number of a system; ground stations have 255."""


class MavlinkBridge:
    """Systems of all vehicles, and the link that they share."""

    def __init__(self, options: MavlinkOptions) -> None:
        self._options = options
        self._systems: dict[int, MavlinkSystem] = {}

    def open(self, node: Node) -> None:
        """Open the link; raise the error of a wrong option."""
        given = self._options
        self._origin = given.place
        self._link = MavlinkLink(given.peer, given.secret, node.log)
        self._link.start(self._take, self._tick, node.post)
        node.log.info("sending to %s", given.address)

    def add(self, node: Node, _params: Params) -> None:
        """Add the system of a vehicle; raise UsageError for one vehicle too many."""
        number = len(self._systems) + 1
        if number > _MOST:
            raise UsageError(f"MAVLink has numbers for {_MOST} vehicles", "name some by --vehicle")
        send, poses = self._link.sender(number), list[Subscription[Any]]()

        def listen(every: bool) -> None:
            if poses and not every:
                node.unlisten(poses.pop())
            elif every and not poses:
                poses.append(node.listen(POSE, system.see))

        system = self._systems[number] = MavlinkSystem(
            BridgedVehicle(node), lambda every: node.post(partial(listen, every)),
            self._origin, send, node.log,
        )  # fmt: skip
        node.listen(POSE_SLOW, system.see)
        node.listen(STATE, system.see)
        system.learn_start()

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


if __name__ == "__main__":
    run_bridge("mavlink", MavlinkOptions, MavlinkBridge)
