"""`fleet goto`: the goals typed, formations, and the flights of all vehicles."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import fsum
from typing import Annotated, Any

from msgspec import Struct

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option, is_number
from quadctl.cli.fleet.file import FleetFile, Member
from quadctl.cli.fleet.hubs import File, Hubs, fail, fleet_of, no_vehicle_sent, row
from quadctl.cli.progress import FleetProgress
from quadctl.cli.vehicle.goto import check_arrive, report
from quadctl.schemas.messages import Position
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.topics import STATE
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused, UsageError
from quadctl.services.runtime.params.names import nearest
from quadctl.vehicle import Flight, goal_of

_HINT = "fleet goto X Y Z | FORMATION [X Y Z] | VEHICLE=X,Y,Z ..; `quadctl fleet goto --help`"


class FleetGoal(Struct, frozen=True):
    """Goals of vehicles by name, or a formation and its centre, or a centre alone; m."""

    own: dict[str, Position] = {}
    formation: str = ""
    at: Position = Position(0.0, 0.0, 0.0)


def read(words: Sequence[str]) -> FleetGoal:
    """Read `uav0=1,2,1`, `line 0 0 1` or `1 2 1`; raise UsageError, or Invalid for a bad point."""
    if all("=" in word for word in words):
        goals: dict[str, Position] = {}
        for word in words:
            name, _, text = word.partition("=")
            if name in goals:
                raise UsageError(f"{name} is given two goals", "name each vehicle once")
            goals[name] = _point(text.split(","))
        return FleetGoal(own=goals)
    if is_number(words[0]):
        return FleetGoal(at=_point(words))
    title, *rest = words
    return FleetGoal(formation=title, at=_point(rest)) if rest else FleetGoal(formation=title)


def _point(words: Sequence[str]) -> Position:
    if len(words) != 3 or not all(map(is_number, words)):
        raise UsageError(f"'{' '.join(words)}' is not a point: give three numbers", _HINT)
    x, y, z = map(float, words)
    # Refuses a point that every vehicle would refuse.
    goal_of(x, y, z, replace=False)
    return Position(x, y, z)


Places = Mapping[str, Position]  # a point (m) for each vehicle


def named_goals(target: FleetGoal, fleet: FleetFile) -> dict[str, Position] | None:
    """Return the goals by vehicle or formation, None for a centre; raise Invalid if unknown."""
    names = [member.name for member in fleet.members]
    for name in target.own:
        if name not in names:
            hint = nearest(name, names) or f"the vehicles are {', '.join(names)}"
            raise Invalid(f"there is no vehicle {name}", hint)
    if target.own or not target.formation:
        return target.own or None
    title = target.formation
    if title not in fleet.formations:
        source = fleet.source or "fleet.toml"
        line = f"{fleet.members[0].name} = [1.0, 2.0, 0.5], metres"
        hint = f"write in {source}: [formations.{title}], and below it, for each vehicle, {line}"
        if fleet.formations:
            hint = nearest(title, fleet.formations) or f"{source} has {', '.join(fleet.formations)}"
        raise Invalid(f"there is no formation {title}", hint)
    return _moved(fleet.formations[title], target.at)


def about(places: Places, to: Position) -> dict[str, Position]:
    """Return the places moved to a new centre, each as far from it as before."""
    count = len(places)
    x, y, z = (fsum(getattr(p, axis) for p in places.values()) / count for axis in "xyz")
    offsets = {name: Position(p.x - x, p.y - y, p.z - z) for name, p in places.items()}
    return _moved(offsets, to)


def _moved(places: Places, by: Position) -> dict[str, Position]:
    return {name: Position(by.x + p.x, by.y + p.y, by.z + p.z) for name, p in places.items()}


_GOAL = "X Y Z | FORMATION [X Y Z] | VEHICLE=X,Y,Z .."
_WHY = "`quadctl fleet list` shows all; one vehicle's cage: `quadctl cage show --vehicle`"
_BUSY = "`--replace` changes course; `quadctl fleet hold` stops all"


def goto(
    options: Options,
    goal: Annotated[list[str], Arg("Goal, m.", _GOAL)],
    no_wait: Annotated[bool, Option("Return after the verdicts.")] = False,
    replace: Annotated[bool, Option("Change course of vehicles in flight.")] = False,
    arrive: Annotated[
        float | None, Option("Seconds to arrive in (default: twice the planned time plus 5).")
    ] = None,
    file: File = None,
) -> None:
    """Fly all vehicles to their goals, if safety permits each goal, and wait for the arrivals.

    X Y Z is the new centre of all: they keep their formation, and if one is away none is sent. A
    formation of the fleet's file is flown about X Y Z, or the origin, and VEHICLE=X,Y,Z sends the
    vehicles named; then a vehicle that is away delays none of the others. Nothing prevents
    collisions between the vehicles.

    Example: quadctl fleet goto 0 0 2
    """
    check_arrive(arrive)
    target = read(goal)
    with Hubs(options) as hubs:
        fleet = fleet_of(options, file, hubs)
        requests = {
            name: _request(name, place, target, replace=replace)
            for name, place in _goals(target, fleet, hubs).items()
        }
        if target.formation and not options.json:
            _note_absent(target.formation, fleet, requests)
        members = [member for member in fleet.members if member.name in requests]
        accepted: list[str] = []
        with _note_interrupt(accepted):
            answers, problems = _ask(hubs, members, requests, accepted, options)
            flying = [m for m in members if (one := answers.get(m.name)) and one.accepted]
            if flying and not no_wait:
                problems |= _watch(hubs, flying, answers, arrive, quiet=options.json)
    if options.json:
        output.document(
            [
                row(
                    m,
                    options,
                    problems.get(m.name),
                    **report(answers.get(m.name), followed=not no_wait),
                )
                for m in members
            ]
        )
    fail({m.name: problems[m.name] for m in members if m.name in problems})


def _goals(target: FleetGoal, fleet: FleetFile, hubs: Hubs) -> dict[str, Position]:
    goals = named_goals(target, fleet)
    if goals is not None:
        return goals
    # Goals, not positions: arriving within the range, a vehicle would fall behind each time.
    states = hubs.ask(
        fleet.members, lambda _, client: client.latest(STATE).goal, bounded=True, all_or_none=True
    )
    if states.problems:
        # The centre depends on every vehicle.
        raise no_vehicle_sent(states.problems, [member.name for member in fleet.members])
    return about(states.answers, target.at)


def _request(name: str, place: Position, target: FleetGoal, *, replace: bool) -> GotoRequest:
    try:
        return goal_of(place.x, place.y, place.z, replace=replace)
    except Invalid as problem:
        about_ = f"{target.at.x:g} {target.at.y:g} {target.at.z:g}"
        raise Invalid(f"about {about_}, {name}'s {problem.message}", problem.hint) from problem


def _note_absent(title: str, fleet: FleetFile, sent: Mapping[str, Any]) -> None:
    stay = [member.name for member in fleet.members if member.name not in sent]
    if stay:
        have, they = ("has", "it stays") if len(stay) == 1 else ("have", "they stay")
        output.note(f"{', '.join(stay)} {have} no place in {title}: {they}")


@contextmanager
def _note_interrupt(accepted: Collection[str]) -> Iterator[None]:
    """On Ctrl-C, note that the vehicles with an accepted goal fly on."""
    try:
        yield
    except KeyboardInterrupt:
        if accepted:
            output.note("stopped waiting: the flights go on; `quadctl fleet hold` stops them")
        raise


def _ask(
    hubs: Hubs,
    members: list[Member],
    requests: Mapping[str, GotoRequest],
    accepted: list[str],
    options: Options,
) -> tuple[dict[str, Flight], dict[str, QuadctlError]]:
    """Send all goals; add each vehicle that accepts to `accepted` at once."""

    def ask(member: Member, client: Client) -> Flight:
        left, client.timeout = client.timeout, options.timeout
        flight = Flight(client, requests[member.name], left)
        if flight.accepted:
            accepted.append(member.name)
        return flight

    results = hubs.ask(members, ask, bounded=True)
    problems = dict(results.problems)
    for name, flight in results.answers.items():
        verdict = "accepted" if flight.accepted else f"rejected: {flight.reason}"
        if not options.json:
            output.line(f"{name}: {verdict}")
        if not flight.accepted:
            hint = _BUSY if flight.reason.startswith("busy") else _WHY
            problems[name] = Refused(flight.reason, hint)
    return results.answers, problems


def _watch(
    hubs: Hubs,
    members: list[Member],
    answers: Mapping[str, Flight],
    arrive: float | None,
    *,
    quiet: bool,
) -> dict[str, QuadctlError]:
    """Show the flights until all have ended; return the problem of each that missed its goal."""
    with FleetProgress("flying", [member.name for member in members], quiet=quiet) as board:

        def watch(member: Member, _client: Client) -> None:
            flight = answers[member.name]
            whole = max(flight.begin(), 1e-6)
            flight.wait(arrive, lambda left: board.fly(member.name, left, whole))
            board.fly(member.name, 0.0, whole)

        problems = hubs.ask(members, watch, bounded=False).problems
    for member in members:
        flight = answers[member.name]
        if flight.arrived and not quiet:
            way = f"within {flight.distance:.2f} m after {flight.seconds:.2f} s"
            output.line(f"{member.name}: arrived {way}")
    return problems
