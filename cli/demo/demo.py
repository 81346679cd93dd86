"""`demo`: the lab's four checkpoints, flown in a separate realm, with the evidence of each."""

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

from msgspec import Struct

from quadctl.cli import output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Option
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.messages import Pose, Position, Pressure
from quadctl.schemas.params import Params
from quadctl.schemas.services import CalibrateRequest, ToggleCageRequest
from quadctl.schemas.topics import CALIBRATE, POSE, PRESSURE, STATE, TOGGLE_CAGE
from quadctl.schemas.zones import ZoneParams
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.files import free_name, refuse_existing
from quadctl.services.runtime.params.catalogue import lab_params
from quadctl.services.runtime.realm import DEFAULT
from quadctl.services.runtime.supervisor.launch import Launch
from quadctl.vehicle import Flight, distance, goal_of

TOUR = (Position(-3.0, -2.0, 1.5), Position(-2.0, 3.0, 0.8), Position(1.0, 2.0, 1.0))
HOME = TOUR[-1]
OUTSIDE = Position(9.0, 0.0, 1.0)
TOWER = ZoneParams("tower", polygon=((-1.2, 0.3), (0.0, 0.3), (0.0, 1.5), (-1.2, 1.5)))
"""Zone on the straight way from the tour's end to its first point, beside all other ways."""
IN_TOWER = Position(-0.6, 0.9, 1.0)
_STILL = 0.05
"""Movement (m) below which a vehicle has stayed."""
_GRADIENT = 0.12
"""Change of the pressure with height, hPa/m, rounded up."""
_AT_REST = 0.01
"""Speed (m/s) below which a vehicle hovers."""
_AVERAGED = 1.1
"""Time (s) at rest: the second that a calibration averages, and a tenth."""
_NOISE = 1e-3
"""Error (hPa) allowed to a zeroed reading beyond the height moved."""


class Evidence(Struct, frozen=True):
    """Observation of a checkpoint, and its verdict."""

    holds: bool
    text: str


class Lab:
    """Live system under test."""

    def __init__(self, client: Client, params: Params, safety_log: Path) -> None:
        self.client, self.params, self.safety_log = client, params, safety_log

    def goto(self, goal: Position, *, direct: bool = False) -> tuple[Flight, int]:
        """Request a goal and fly there; return the flight, and its legs if it has several, else 0."""
        flight = Flight(self.client, goal_of(goal.x, goal.y, goal.z, direct=direct))
        legs = 0
        if flight.accepted:
            legs = self.client.latest(STATE).legs
            flight.wait()
        return flight, legs

    def hover(self) -> Position:
        """Wait until the vehicle has hovered for the second that a calibration averages."""
        stream = self.client.listen(POSE.key(self.client.vehicle))
        rest_since = None
        while message := stream.next(self.client.timeout):
            pose = codec.decode(Pose, message.payload, message.encoding)
            speed = math.hypot(pose.velocity.x, pose.velocity.y, pose.velocity.z)
            if speed > _AT_REST or rest_since is None:
                rest_since = pose.stamp
            elif pose.stamp - rest_since > _AVERAGED:
                return pose.position
        raise self.client.silent(POSE.key(self.client.vehicle))

    def readings(self, count: int) -> list[Pressure]:
        """Return the next readings of the barometer."""
        stream = self.client.listen(PRESSURE.key(self.client.vehicle))
        found = []
        for _ in range(count):
            message = stream.next(self.client.timeout)
            if message is None:
                raise self.client.silent(PRESSURE.key(self.client.vehicle))
            found.append(codec.decode(Pressure, message.payload, message.encoding))
        return found


def parameters(lab: Lab) -> Iterator[Evidence]:
    """Check that safety logged the parameters of the file."""
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
    """Fly to waypoints inside; check that one outside is rejected and moves nothing.

    Check that a zone bars its inside and the way through it, and that a flight leads around it.
    """
    for goal in TOUR:
        yield _flown(lab, goal)
    before = lab.hover()
    yield _refused(lab, OUTSIDE)
    moved = distance(before, lab.client.first(POSE).position)
    yield Evidence(moved < _STILL, f"the vehicle has moved {moved * 1000:.1f} mm")
    yield _refused(lab, IN_TOWER)
    yield _refused(lab, TOUR[0], direct=True)
    for goal in (TOUR[0], HOME):
        yield _flown(lab, goal, around=True)


def calibration(lab: Lab) -> Iterator[Evidence]:
    """Check that the barometer reads the standard atmosphere, and zero it."""
    before = lab.hover().z
    raw = lab.readings(3)[-1].pressure
    yield Evidence(1012 < raw < 1014, f"sensors/pressure shows {raw:.4f} hPa")
    baseline = lab.client.call(CALIBRATE, CalibrateRequest(zero=True)).baseline
    yield Evidence(abs(baseline - raw) < _GRADIENT, f"baseline: {baseline:.4f} hPa")
    zeroed = lab.readings(5)[-1].pressure
    allowed = _GRADIENT * abs(lab.client.first(POSE).position.z - before) + _NOISE
    yield Evidence(abs(zeroed) < allowed, f"sensors/pressure now shows {zeroed:+.6f} hPa")


def cage_service(lab: Lab) -> Iterator[Evidence]:
    """Check that a goal outside is rejected with the cage on and flown to with it off, and fly home."""
    yield _refused(lab, OUTSIDE)
    lab.client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on=False))
    yield Evidence(not lab.client.latest(STATE).cage_on, "toggle_cage: the cage is off")
    yield _flown(lab, OUTSIDE)
    reply = lab.client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on=True))
    on = reply.success and lab.client.latest(STATE).cage_on
    yield Evidence(on, "toggle_cage: the cage is on again, with the vehicle outside")
    yield _flown(lab, HOME)


def _flown(lab: Lab, goal: Position, *, around: bool = False) -> Evidence:
    name = f"goto {goal.x:g} {goal.y:g} {goal.z:g}"
    try:
        flight, legs = lab.goto(goal)
    except QuadctlError as problem:
        return Evidence(False, f"{name}: {problem.message}")
    if flight.reason:
        return Evidence(False, f"{name}: refused, {flight.reason}")
    text = f"{name}: arrived within {flight.distance:.2f} m after {flight.seconds:.2f} s"
    there = flight.distance <= lab.params.safety.acceptance_range
    if around:
        return Evidence(there and legs > 1, f"{text}, in {legs} legs around the zone")
    return Evidence(there, text)


def _refused(lab: Lab, goal: Position, *, direct: bool = False) -> Evidence:
    flight, _ = lab.goto(goal, direct=direct)
    name = f"goto {goal.x:g} {goal.y:g} {goal.z:g}{' --direct' if direct else ''}"
    return Evidence(bool(flight.reason), f"{name}: {flight.reason or 'was not refused'}")


CHECKPOINTS: tuple[tuple[str, Callable[[Lab], Iterator[Evidence]]], ...] = (
    ("parameters live outside the code", parameters),
    ("the automaton verifies every waypoint", automaton),
    ("a service calibrates the pressure sensor", calibration),
    ("a service turns the cage on and off", cage_service),
)


def demo(
    options: Options,
    picture: Annotated[
        Path | None,
        Option("Picture of the flight, PNG or SVG (default: demo.png or demo_1.png ..)."),
    ] = None,
    force: Annotated[bool, Option("Overwrite a picture that is there.")] = False,
) -> None:
    """Fly the lab's four checkpoints, show the evidence, and draw the flight.

    Example: quadctl demo --picture flight.svg
    """
    require_local(options, "demo")
    from quadctl.cli.plot.figure import draw
    from quadctl.cli.plot.track import RecordedFlight, drawn

    picture = picture or free_name("demo", ".png")
    refuse_existing(picture, force=force)
    params = lab_params()
    params.safety.zones = [TOWER]
    vehicle = options.named or DEFAULT
    launch = Launch(f"demo-{os.getpid()}", {vehicle: params}, [], str(Path.cwd()))
    with (
        temporary_run(launch) as realm,
        Client(launch.realm, vehicle, timeout=options.timeout) as client,
    ):
        poses = client.listen(*drawn(client.vehicle), backlog=100_000, held=True)
        lab = Lab(client, params, realm.logs / "safety.log")
        report = [
            _fly(number, title, list(checkpoint(lab)), quiet=options.json)
            for number, (title, checkpoint) in enumerate(CHECKPOINTS, start=1)
        ]
        flight = RecordedFlight()
        while (message := poses.next(0)) is not None:
            flight.add(message.key, message.decoded)
        draw(picture, flight, "quadctl demo: the lab's four checkpoints, flown")
    holds = all(checkpoint["holds"] for checkpoint in report)
    if options.json:
        output.document({"ok": holds, "checkpoints": report, "picture": str(picture)})
    else:
        output.line(f"picture of the flight: {picture}")
        output.line("all checkpoints hold" if holds else "some checkpoints do not hold")
    output.end(ok=holds)


def _fly(number: int, title: str, evidence: list[Evidence], *, quiet: bool) -> dict[str, Any]:
    holds = all(item.holds for item in evidence)
    if not quiet:
        output.line(f"Checkpoint {number}: {title}: {'holds' if holds else 'FAILS'}")
        for item in evidence:
            output.line(f"  {'ok  ' if item.holds else 'FAIL'}  {item.text}")
    return {"name": title, "holds": holds, "evidence": evidence}
