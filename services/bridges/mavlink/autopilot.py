"""Process of an autopilot that is not ours, in the place of dynamics: one socket for all vehicles.

In a run it is the node `dynamics`. Of several vehicles each is a system, with the numbers 1, 2 ..
"""

import os
import threading
import time
from functools import partial
from typing import Any

from quadctl.schemas.messages import Pose, SafetyState, Setpoint, Zones
from quadctl.schemas.params import Params
from quadctl.schemas.services import ResetRequest, ResetResponse
from quadctl.schemas.topics import (
    POSE,
    POSE_SLOW,
    RESET,
    SETPOINT,
    STATE,
    ZONES,
)
from quadctl.services.bridges.base import run_bridge
from quadctl.services.bridges.mavlink.adapter import POSE_HZ, US, AutopilotAdapter, Guarded
from quadctl.services.bridges.mavlink.link import MavlinkLink
from quadctl.services.bridges.options import AutopilotOptions
from quadctl.services.runtime.errors import Invalid, Refused
from quadctl.services.runtime.followed_params import follow
from quadctl.services.runtime.node import Node


class AutopilotProcess:
    """Link that the vehicles share."""

    def __init__(self, options: AutopilotOptions) -> None:
        self._options = options
        self._vehicles: list[AutopilotNode] = []
        self._is_single = True

    def open(self, node: Node) -> None:
        """Open the link; raise the error of a wrong option, or Refused for a port that is taken."""
        given = self._options
        self.origin, self.fenced = given.place, given.fenced
        try:
            self._link = MavlinkLink(given.peer, given.secret, node.log)
        except OSError as error:
            raise Refused(
                f"{given.given}: {error.strerror}", "is another program there?"
            ) from error
        self.send = self._link.sender(*US)
        self._link.start(self._take, self._tick, node.post)
        node.log.info("waiting for an autopilot: %s", given.given)

    def add(self, node: Node, params: Params) -> None:
        """Stand for a vehicle; a single one takes the first system that comes."""
        if params.dynamics.in_lockstep:
            raise Invalid(
                "an autopilot flies in real time, not in lock-step",
                "set dynamics.speed to 1 and dynamics.lockstep to false",
            )
        if params.safety.takeoff > 0:
            raise Invalid("safety.takeoff: the pilot takes off, not safety", "set it to 0")
        self._is_single = node.single
        self._vehicles.append(AutopilotNode(self, node, params))

    def _take(self, message: Any) -> None:
        number = message.get_srcSystem()
        if self._is_single:
            for vehicle in self._vehicles:
                vehicle.take(message)
        elif 0 < number <= len(self._vehicles):
            self._vehicles[number - 1].take(message)

    def _tick(self) -> None:
        for vehicle in tuple(self._vehicles):
            vehicle.tick()


class AutopilotNode:
    """Topics of one vehicle, and the autopilot behind them."""

    def __init__(self, process: AutopilotProcess, node: Node, params: Params) -> None:
        self._node, self._params = node, params
        self._adapter = AutopilotAdapter(
            process.origin, params.dynamics, process.send, node.log,
            lambda: os.urandom(4).hex(), fenced=process.fenced,
        )  # fmt: skip
        # Messages come on the link's thread, setpoints on the node's.
        self._lock = threading.Lock()
        self._poses = node.publisher(POSE, lambda: POSE_HZ)
        self._due_poses = node.publisher(POSE_SLOW)
        self._last = ("", -1)
        self._cage: Any = None
        self._zones: Zones | None = None
        self._setpoints = node.listen(SETPOINT, self._on_setpoint)
        node.listen(STATE, self._on_state)
        node.listen(ZONES, self._on_zones)
        # Safety has the parameters of its own; the margin makes the fence wider.
        follow(node, "safety", params, self._guard)
        node.serve(RESET, _refuse_reset)

    def take(self, message: Any) -> None:
        """Take a message of the autopilot; its pose is published on the node's loop."""
        with self._lock:
            pose = self._adapter.take(message, time.monotonic())
        if pose is not None:
            self._node.post(partial(self._publish, pose))

    def tick(self) -> None:
        """Send what is due."""
        with self._lock:
            self._adapter.tick(time.monotonic())

    def _publish(self, pose: Pose) -> None:
        self._poses.put(pose)
        period = pose.boot, POSE_SLOW.period(pose.stamp)
        if period != self._last:
            self._last = period
            self._due_poses.put(pose)
        self._node.advance_sim_time(pose.boot, pose.stamp)

    def _on_setpoint(self, setpoint: Setpoint) -> None:
        with self._lock:
            self._adapter.follow(setpoint, self._setpoints.received)

    def _on_state(self, state: SafetyState) -> None:
        self._cage = state.cage
        self._guard()

    def _on_zones(self, zones: Zones) -> None:
        self._zones = zones
        self._guard()

    def _guard(self) -> None:
        if self._cage is not None and self._zones is not None:
            guarded = Guarded(self._cage, self._zones.zones, self._params.safety.margin)
            with self._lock:
                self._adapter.guard(guarded)


def _refuse_reset(_request: ResetRequest) -> ResetResponse:
    raise Refused("an autopilot cannot be put back at its start", "land it, and take off again")


if __name__ == "__main__":
    run_bridge("dynamics", AutopilotOptions, AutopilotProcess)
