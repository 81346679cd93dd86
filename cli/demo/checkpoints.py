"""The four checkpoints of the lab, flown on a live system, with the evidence of each."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from quadctl.cli.vehicle.goto import Flight, distance, patience
from quadctl.schemas.messages import Pose, Position, Pressure
from quadctl.schemas.params import Params
from quadctl.schemas.services import CalibrateRequest, GotoRequest, ToggleCageRequest
from quadctl.schemas.topics import CALIBRATE, GOTO, POSE, PRESSURE, STATE, TOGGLE_CAGE
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError

TOUR = (Position(-3.0, -2.0, 1.5), Position(-2.0, 3.0, 0.8), Position(1.0, 2.0, 1.0))
HOME = TOUR[-1]
OUTSIDE = Position(9.0, 0.0, 1.0)
_STILL = 0.05
"""A vehicle that moves less (m) has stayed."""
_GRADIENT = 0.12
"""How much the pressure changes with height, hPa/m."""
_AT_REST = 0.01
"""A vehicle slower than this (m/s) hovers."""
_AVERAGED = 1.1
"""The second that a calibration averages, and a tenth."""
_NOISE = 1e-3
"""What a zeroed reading may differ beyond the height moved, hPa."""


class Evidence(NamedTuple):
    """One thing seen, and whether it is as it should be."""

    holds: bool
    text: str


class Lab:
    """A live system under test."""

    def __init__(self, client: Client, params: Params, safety_log: Path) -> None:
        self.client, self.params, self.safety_log = client, params, safety_log

    def goto(self, goal: Position) -> tuple[str, Flight]:
        """Ask for a goal and fly there; returns why it was refused, empty when it was taken."""
        flight = Flight(self.client, goal)
        reply = self.client.call(GOTO, GotoRequest(goal.x, goal.y, goal.z))
        if reply.accepted:
            flight.begin()
            flight.watch(patience(self.client, flight.distance))
        return reply.reason, flight

    def hover(self) -> Position:
        """Wait until the vehicle has stood still for the second that a calibration averages."""
        stream = self.client.listen(POSE.key(self.client.vehicle))
        still_since = None
        while message := stream.next(self.client.timeout):
            pose = codec.decode(Pose, message.payload, message.encoding)
            speed = math.hypot(pose.velocity.x, pose.velocity.y, pose.velocity.z)
            if speed > _AT_REST or still_since is None:
                still_since = pose.stamp
            elif pose.stamp - still_since > _AVERAGED:
                return pose.position
        raise self.client.silent(POSE.key(self.client.vehicle))

    def readings(self, count: int) -> list[Pressure]:
        """The next readings of the barometer."""
        stream = self.client.listen(PRESSURE.key(self.client.vehicle))
        found = []
        for _ in range(count):
            message = stream.next(self.client.timeout)
            if message is None:
                raise self.client.silent(PRESSURE.key(self.client.vehicle))
            found.append(codec.decode(Pressure, message.payload, message.encoding))
        return found


def parameters(lab: Lab) -> Iterator[Evidence]:
    """The file's values are what safety runs with, as its log says."""
    cage = lab.params.safety.virtual_cage
    logged = lab.safety_log.read_text().splitlines()
    for line in (
        f"Param: cage x - [{-cage.x}, {cage.x}]",
        f"Param: cage y - [{-cage.y}, {cage.y}]",
        f"Param: cage z - [0.0, {cage.z}]",
        f"Param: acceptance range - {lab.params.safety.acceptance_range}",
    ):
        yield Evidence(line in logged, f"safety logged `{line}`")


def automaton(lab: Lab) -> Iterator[Evidence]:
    """A waypoint inside is flown to; one outside is refused and moves nothing."""
    for goal in TOUR:
        yield _flown(lab, goal)
    before = lab.hover()
    yield _refused(lab, OUTSIDE)
    moved = distance(before, lab.client.first(POSE).position)
    yield Evidence(moved < _STILL, f"the vehicle has moved {moved * 1000:.1f} mm")


def calibration(lab: Lab) -> Iterator[Evidence]:
    """The barometer reads the standard atmosphere, is zeroed, and can be un-zeroed."""
    before = lab.hover().z
    raw = lab.readings(3)[-1].pressure
    yield Evidence(1012 < raw < 1014, f"sensors/pressure shows {raw:.4f} hPa")
    baseline = lab.client.call(CALIBRATE, CalibrateRequest(zero=True)).baseline
    yield Evidence(abs(baseline - raw) < _GRADIENT, f"baseline: {baseline:.4f} hPa")
    zeroed = lab.readings(5)[-1].pressure
    allowed = _GRADIENT * abs(lab.client.first(POSE).position.z - before) + _NOISE
    yield Evidence(abs(zeroed) < allowed, f"sensors/pressure now shows {zeroed:+.6f} hPa")


def cage_service(lab: Lab) -> Iterator[Evidence]:
    """Refused with the cage on, flown to with it off; back on, the way home is open."""
    yield _refused(lab, OUTSIDE)
    lab.client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on=False))
    yield Evidence(not lab.client.latest(STATE).cage_on, "toggle_cage: the cage is off")
    yield _flown(lab, OUTSIDE)
    reply = lab.client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on=True))
    on = reply.success and lab.client.latest(STATE).cage_on
    yield Evidence(on, "toggle_cage: the cage is on again, with the vehicle outside")
    yield _flown(lab, HOME)


CHECKPOINTS: tuple[tuple[str, Callable[[Lab], Iterator[Evidence]]], ...] = (
    ("parameters live outside the code", parameters),
    ("the automaton verifies every waypoint", automaton),
    ("a service calibrates the pressure sensor", calibration),
    ("a service turns the cage on and off", cage_service),
)


def _flown(lab: Lab, goal: Position) -> Evidence:
    name = f"goto {goal.x:g} {goal.y:g} {goal.z:g}"
    try:
        reason, flight = lab.goto(goal)
    except QuadctlError as problem:
        return Evidence(False, f"{name}: {problem.message}")
    if reason:
        return Evidence(False, f"{name}: refused, {reason}")
    text = f"{name}: arrived within {flight.distance:.2f} m after {flight.seconds:.2f} s"
    return Evidence(flight.distance <= lab.params.safety.acceptance_range, text)


def _refused(lab: Lab, goal: Position) -> Evidence:
    reason, _ = lab.goto(goal)
    name = f"goto {goal.x:g} {goal.y:g} {goal.z:g}"
    return Evidence(bool(reason), f"{name}: {reason or 'was not refused'}")
