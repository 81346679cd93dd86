"""`fleet hold` and `fleet land-all`."""

from collections import Counter
from contextlib import suppress
from threading import Barrier, BrokenBarrierError
from typing import Annotated

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.fleet.file import Member
from quadctl.cli.fleet.hubs import File, Hubs, fleet_of, print_results, row
from quadctl.cli.fleet.sequence import settled
from quadctl.cli.progress import FleetProgress
from quadctl.cli.vehicle.goto import check_arrive
from quadctl.schemas.messages import Pose, Position, SafetyState
from quadctl.schemas.services import GotoRequest, HoldRequest
from quadctl.schemas.topics import HOLD, STATE
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Refused
from quadctl.vehicle import Flight, distance, speed


def hold(options: Options, file: File = None) -> None:
    """Stop all vehicles at once, each hovering at its stopping point.

    A hub that is away delays none of the others. Exit 0 if all have stopped, else the worst code:
    no answer (3) before a timeout (4) before a refusal (5).

    Example: quadctl fleet hold --fleet fleet.toml
    """
    with Hubs(options) as hubs:
        members = fleet_of(options, file, hubs).members
        found = hubs.ask(members, lambda _, client: client.call(HOLD, HoldRequest()))
    rows = [
        row(m, options, found.problems.get(m.name), stopped=m.name in found.answers)
        for m in members
    ]
    stopped = dict.fromkeys(found.answers, "stopping: hovering at the stopping point")
    print_results(options, rows, stopped, found.problems)


_STOPPING = 5.0  # s to come to rest; in gusts a vehicle never does, and lands from where it is
_IDLE = 3.0
"""Simulated s on the ground after which a vehicle has landed although safety does not report its
arrival: wind blew it farther off its goal than the acceptance range. Its motors idle by then."""
_DOWN, _STILL, _AT_REST = 0.05, 0.01, 0.2
"""Height (m), speed (m/s) and simulated s: a vehicle below both for that long is on the ground. In
gusts a hovering vehicle is never that still."""


def land_all(
    options: Options,
    arrive: Annotated[
        float | None, Option("Seconds to land in (default: twice the planned time plus 5).")
    ] = None,
    file: File = None,
) -> None:
    """Stop all vehicles and land each straight down; one outside its cage, at the cage's edge.

    A hub that is away delays none of the others. Exit 0 if all have landed, else the worst code:
    no answer (3) before a timeout (4) before a refusal (5). No vehicle lands on another one: safety
    refuses that.

    Example: quadctl fleet land-all
    """
    check_arrive(arrive)
    with Hubs(options) as hubs:
        members = fleet_of(options, file, hubs).members
        hub_sizes = Counter(member.connect for member in members)
        told = {connect: Barrier(size) for connect, size in hub_sizes.items()}
        with FleetProgress(
            "landing", [member.name for member in members], quiet=options.json
        ) as board:

            def land(member: Member, client: Client) -> Position:
                left, client.timeout = client.timeout, options.timeout
                _stop(client, left, told[member.connect])
                return _land(client, board, member.name, arrive)

            try:
                found = hubs.ask(members, land)
            except KeyboardInterrupt:
                output.note("stopped waiting: the landings go on; `quadctl fleet hold` stops them")
                raise
    rows = []
    for m in members:
        at, problem = found.answers.get(m.name), found.problems.get(m.name)
        rows.append(row(m, options, problem, landed=at is not None, position=at))
    landed = {name: f"landed at {at.x:.2f} {at.y:.2f}" for name, at in found.answers.items()}
    print_results(options, rows, landed, found.problems)


class _Descent(Flight):
    """Flight to the ground: over when the vehicle rests there, however far off the goal."""

    pose: Pose | None = None
    _still_since, _reached = 0.0, False

    def _patience(self, metres: float) -> float:
        return super()._patience(max(metres, 1e-6)) + _IDLE

    def _read(self, message: Pose | SafetyState) -> None:
        super()._read(message)
        if isinstance(message, Pose):
            first, self.pose = self.pose is None, message
            flies = message.position.z > _DOWN or speed(message) > _STILL
            if first or flies or not self._moving:
                self._still_since = message.stamp
        self._reached = self._reached or self._arrived
        long = _AT_REST if self._reached else _IDLE
        self._arrived = self.pose is not None and self.pose.stamp - self._still_since > long


def _stop(client: Client, left: float, told: Barrier) -> None:
    """Stop a vehicle within `left` s, and wait until the others of its hub were told to stop, too.

    Until then another one may fly to a goal just where this one is to land.
    """
    try:
        client.call(HOLD, HoldRequest(), left)
    finally:
        # A vehicle that is not connected in time never comes here.
        with suppress(BrokenBarrierError):
            told.wait(left)


def _land(client: Client, board: FleetProgress, name: str, arrive: float | None) -> Position:
    """Land a vehicle that stops; return the position on the ground, or raise the obstacle."""
    # The way down of one that still stops is as wide as its stop: safety may refuse it beside another.
    at = settled(client, _STOPPING).position
    goal = ground_below(at, client.latest(STATE))
    flight = _Descent(client, GotoRequest(goal.x, goal.y, goal.z, replace=True, wait=True))
    if not flight.accepted:
        raise Refused(flight.reason, "it hovers; `quadctl fleet list` shows where")
    whole = max(distance(at, goal), 1e-6)
    flight.wait(arrive, lambda to_go: board.fly(name, to_go, whole))
    if client.latest(STATE).state == "MOVING":
        # Without a hold it would stay busy for ever.
        client.call(HOLD, HoldRequest())
    board.fly(name, 0.0, whole)
    return flight.pose.position if flight.pose else goal


def ground_below(place: Position, state: SafetyState) -> Position:
    """Return the ground point straight below; outside the cage, the nearest one inside."""
    if not state.cage_on:
        return Position(place.x, place.y, 0.0)
    x, y = state.cage.x, state.cage.y
    return Position(min(max(place.x, -x), x), min(max(place.y, -y), y), 0.0)
