"""Process of an autopilot that is not ours, in the place of dynamics: one socket for all vehicles.

python -P -m quadctl.services.mavlink.autopilot --connect udpin:127.0.0.1:14540
    --origin LAT LON ALT [--signing-key FILE] [--no-fence]

In a run it is the node `dynamics`. Of several vehicles each is a system, with the numbers 1, 2 ..
"""

import argparse
import os
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import convert

from quadctl.schemas.earth import origin_of
from quadctl.schemas.messages import Called, Pose, SafetyState, Setpoint, Zones
from quadctl.schemas.params import Params
from quadctl.schemas.services import ResetRequest, ResetResponse, SetParamsRequest
from quadctl.schemas.topics import (
    POSE,
    POSE_SLOW,
    RESET,
    SETPOINT,
    STATE,
    ZONES,
    called,
    set_params,
)
from quadctl.services.mavlink.adapter import POSE_HZ, US, AutopilotAdapter, Guarded
from quadctl.services.mavlink.link import MavlinkLink
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.runtime.security import bridge_access

_PATIENCE = 2.0
"""Seconds to wait for safety's zones."""


def main() -> None:
    """Parse the options that only the adapter has, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--connect", default="udpin:127.0.0.1:14540")
    parser.add_argument("--origin", nargs=3, type=float, required=True)
    parser.add_argument("--signing-key", type=Path)
    parser.add_argument("--no-fence", action="store_true")
    options, sys.argv[1:] = parser.parse_known_args()
    start("dynamics", partial(run, AutopilotProcess(options)), keeps_time=True)


def run(process: "AutopilotProcess", node: Node, params: Params) -> None:
    """Stand for one vehicle until stopped."""
    if params.dynamics.in_lockstep:
        raise Invalid(
            "an autopilot flies in real time, not in lock-step",
            "set dynamics.speed to 1 and dynamics.lockstep to false",
        )
    if params.safety.takeoff > 0:
        raise Invalid("safety.takeoff: the pilot takes off, not safety", "set it to 0")
    if node.is_first:
        process.open(node)
    vehicle = AutopilotNode(process, node, params)
    process.add(vehicle, single=node.single)

    def reset(_request: ResetRequest) -> ResetResponse:
        raise Refused("an autopilot cannot be put back at its start", "land it, and take off again")

    node.serve(RESET, reset)
    node.spin()


class AutopilotProcess:
    """Link that the vehicles share."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._vehicles: list[AutopilotNode] = []
        self._is_single = True

    def open(self, node: Node) -> None:
        """Open the link; raise QuadctlError for a wrong address or key, or a port that is taken."""
        given, text = self._options, f"--connect {self._options.connect}"
        address = bridge_access.autopilot_address_of(given.connect)
        bridge_access.check_peer(address, text, signed=given.signing_key is not None)
        key = bridge_access.key_of(given.signing_key) if given.signing_key else None
        try:
            self._link = MavlinkLink(address, key, node.log)
        except OSError as error:
            raise Refused(f"{text}: {error.strerror}", "is another program there?") from error
        self.origin, self.fenced = origin_of(given.origin), not given.no_fence
        self.send = self._link.sender(*US)
        self._link.start(self._take, self._tick, node.post)
        node.log.info("waiting for an autopilot: %s", text)

    def add(self, vehicle: "AutopilotNode", *, single: bool) -> None:
        """Add a vehicle; a single one takes the first system that comes."""
        self._is_single = single
        self._vehicles.append(vehicle)

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
            process.origin, params.dynamics, process.send, node.log, _new_name,
            fenced=process.fenced,
        )  # fmt: skip
        # Messages come on the link's thread, setpoints on the node's.
        self._lock = threading.Lock()
        self._poses = node.publisher(POSE, lambda: POSE_HZ)
        self._due_poses = node.publisher(POSE_SLOW)
        self._last = ("", -1)
        self._cage: Any = None
        self._zones: Zones | None = None
        self._asks = False
        self._setpoints = node.listen(SETPOINT, self._on_setpoint)
        node.listen(STATE, self._on_state)
        node.listen(ZONES, self._on_zones)
        # Safety has the parameters of its own; the margin makes the fence wider.
        self._safety = LiveParams("safety", params, lambda _table: None, self._guard)
        node.listen(called(set_params("safety")), self._on_safety_params)

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
        if self._zones is None and not self._asks:
            # Safety publishes its zones when they change, which may be long ago.
            self._asks = True
            threading.Thread(target=self._ask_zones, daemon=True).start()
        self._guard()

    def _ask_zones(self) -> None:
        try:
            zones = self._node.latest(ZONES, _PATIENCE)
        except QuadctlError as problem:
            self._node.log.warning("zones: %s", problem.message)
        else:
            self._node.post(partial(self._on_zones, zones))
        self._asks = False

    def _on_safety_params(self, call: Called) -> None:
        if call.response.get("success"):
            self._safety.set(convert(call.request, SetParamsRequest))

    def _on_zones(self, zones: Zones) -> None:
        self._zones = zones
        self._guard()

    def _guard(self) -> None:
        if self._cage is not None and self._zones is not None:
            guarded = Guarded(self._cage, self._zones.zones, self._params.safety.margin)
            with self._lock:
                self._adapter.guard(guarded)


def _new_name() -> str:
    return os.urandom(4).hex()


if __name__ == "__main__":
    main()
