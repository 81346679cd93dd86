"""`state`: the state of the automaton and the pose of the vehicle."""

from collections.abc import Iterator
from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.schemas.messages import NearestWall, Pose, SafetyState
from quadctl.schemas.topics import POSE, STATE
from quadctl.schemas.zones import CAGE_NAME
from quadctl.services.runtime.bus.client import Client


def state(
    options: Options,
    watch: Annotated[bool, Option("Print each change as it comes, until Ctrl-C.")] = False,
) -> None:
    """Show what the automaton is doing, and where the vehicle is.

    Example: quadctl state --json
    """
    with context.connect(options) as client:
        if watch:
            _watch(client, as_json=options.json)
            return
        shown = _together(client.latest(STATE), client.first(POSE))
    if options.json:
        output.document(shown)
    else:
        output.fields(shown)


def _watch(client: Client, *, as_json: bool) -> None:
    if as_json:
        for now, pose in _with_poses(client):
            output.document(_together(now, pose))
    else:
        for now in _changes(client):
            output.line(_line(now))


def _changes(client: Client) -> Iterator[SafetyState]:
    """Yield the current state and each change; raise Client.silent's error if none comes."""
    states = client.subscribe(STATE)
    now, shown = client.latest(STATE), None
    waiting = list(iter(lambda: states.next(0), None))
    if now not in waiting:
        # Published before we subscribed: any later state arrives before the reply with it.
        waiting.insert(0, now)
    while True:
        # Without new output we would not notice that the reader has left.
        output.ensure_read()
        for state in waiting:
            # Between two changes the distance to a wall is no news, only which one is near.
            wall = state.nearest
            near = NearestWall(wall.name, near=True) if wall.near else NearestWall()
            content = msgspec.structs.replace(state, stamp=0.0, nearest=near)
            if content != shown:
                shown = content
                yield state
        following = states.next(client.timeout)
        if following is None:
            raise client.silent(STATE.key(client.vehicle), states.problem)
        waiting = [following]


def _with_poses(client: Client) -> Iterator[tuple[SafetyState, Pose]]:
    """Yield each change with the newest pose."""
    poses = client.subscribe(POSE)
    pose = poses.next(client.timeout)
    if pose is None:
        raise client.silent(POSE.key(client.vehicle), poses.problem)
    for now in _changes(client):
        while (newer := poses.next(0)) is not None:
            pose = newer
        yield now, pose


def _line(now: SafetyState) -> str:
    goal = " ".join(f"{part:g}" for part in (now.goal.x, now.goal.y, now.goal.z))
    cage = "on" if now.cage_on else "off"
    leg = f"leg {now.leg} of {now.legs}  " if now.legs else ""
    wall = now.nearest
    near = f"near {_wall(wall.name)}: {wall.distance:.2f} m  " if wall.near else ""
    text = f"{now.stamp:.2f} s  {now.state}  {leg}goal {goal}  cage {cage}  {near}{now.reason}"
    return text.rstrip()


def _wall(name: str) -> str:
    return "the cage's wall" if name == CAGE_NAME else f"the zone {name}"


def _together(now: SafetyState, pose: Pose) -> Any:
    return msgspec.to_builtins(now) | {"pose": msgspec.to_builtins(pose)}
