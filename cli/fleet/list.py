"""`fleet list`: the position and state of every vehicle."""

import time

from msgspec import Struct

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.fleet.file import Member
from quadctl.cli.fleet.hubs import File, Hubs, fail, fleet_of, hub_of, row
from quadctl.schemas.messages import Pose, Position, SafetyState
from quadctl.schemas.topics import POSE, STATE
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.streams import QueuedSubscriber, RawMessage
from quadctl.services.runtime.errors import QuadctlError


class _Subscribed(Struct, frozen=True):
    """State of a vehicle, and the subscription to its poses, which goes on."""

    state: SafetyState
    poses: QueuedSubscriber
    first: RawMessage | None
    problem: QuadctlError | None


class _View(Struct, frozen=True):
    """State of a vehicle, and its latest pose, `age` s old."""

    state: SafetyState
    pose: Pose | None = None
    age: float = 0.0
    problem: QuadctlError | None = None


def list_(options: Options, file: File = None) -> None:
    """Show each vehicle: its hub, its state, goal and position (m), the cage, the pose's age (s).

    The age uses the sender's clock, which may differ on another machine.

    Example: quadctl fleet list --json
    """
    with Hubs(options) as hubs:
        members = fleet_of(options, file, hubs).members
        results = hubs.ask(members, _subscribe)
        # Read the poses now, after the wait for the slowest vehicle.
        seen = {name: _view(answer) for name, answer in results.answers.items()}
    partly = {name: one.problem for name, one in seen.items() if one.problem}
    problems = results.problems | partly
    if options.json:
        output.document([_row(m, options, seen.get(m.name), problems.get(m.name)) for m in members])
    else:
        rows = [
            (m.name, hub_of(m, options), *_cells(seen.get(m.name), problems.get(m.name)))
            for m in members
        ]
        output.table(
            [("VEHICLE", "HUB", "STATE", "GOAL", "POSITION", "CAGE", "AGE", "PROBLEM"), *rows]
        )
    fail(problems)


def _subscribe(_member: Member, client: Client) -> _Subscribed:
    ends = time.monotonic() + client.timeout
    key = POSE.key(client.vehicle)
    poses = client.listen(key, backlog=1)
    state = client.latest(STATE)
    first = poses.next(ends - time.monotonic())
    return _Subscribed(state, poses, first, None if first else client.silent(key))


def _view(subscribed: _Subscribed) -> _View:
    message = subscribed.poses.next(0) or subscribed.first
    if message is None:
        return _View(subscribed.state, problem=subscribed.problem)
    try:
        pose = codec.decode(Pose, message.payload, message.encoding)
    except QuadctlError as problem:
        return _View(subscribed.state, problem=problem)
    age = time.time() - (message.published or message.at) / 1e9
    return _View(subscribed.state, pose, age)


def _row(m: Member, options: Options, view: _View | None, problem: QuadctlError | None) -> object:
    state, pose = (view.state, view.pose) if view else (None, None)
    return row(
        m,
        options,
        problem,
        state=state.state if state else None,
        goal=state.goal if state else None,
        position=pose.position if pose else None,
        cage_on=state.cage_on if state else None,
        age=view.age if view and pose else None,
    )


def _cells(view: _View | None, problem: QuadctlError | None) -> tuple[str, ...]:
    trouble = f"{problem.code}: {problem.message}" if problem else ""
    if view is None:
        return ("-", "-", "-", "-", "-", trouble)
    age = f"{view.age:.2f}" if view.pose else "-"
    at = _point(view.pose.position) if view.pose else "-"
    cage = "on" if view.state.cage_on else "off"
    return (view.state.state, _point(view.state.goal), at, cage, age, trouble)


def _point(place: Position) -> str:
    return " ".join(f"{part:.2f}" for part in (place.x, place.y, place.z))
