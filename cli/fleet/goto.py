"""`fleet goto`: the goals typed, formations, and the flights of all vehicles."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from math import fsum
from typing import Annotated, Any

from msgspec import Struct

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option, is_number
from quadctl.cli.fleet.file import FleetFile, Member
from quadctl.cli.fleet.hubs import File, Hubs, fail, fleet_of, no_vehicle_sent, row
from quadctl.cli.fleet.sequence import Closest, Course, Distances, course_of
from quadctl.cli.progress import FleetProgress
from quadctl.cli.vehicle.goto import check_arrive, report
from quadctl.schemas.messages import Position
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.topics import STATE
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.concurrent import ask_each
from quadctl.services.runtime.errors import (
    Invalid,
    QuadctlError,
    Refused,
    TimedOut,
    Unreachable,
    UsageError,
)
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
    vehicles named; then a vehicle that is away delays none of the others.

    Vehicles of one run keep apart: some wait until others have passed, or fly by another height. If
    there is no way for all, none is sent.

    Example: quadctl fleet goto 0 0 2
    """
    check_arrive(arrive)
    target = read(goal)
    with Hubs(options) as hubs:
        fleet = fleet_of(options, file, hubs)
        places = _goals(target, fleet, hubs)
        requests = {
            name: _request(name, place, target, replace=replace) for name, place in places.items()
        }
        if target.formation and not options.json:
            _note_absent(target.formation, fleet, requests)
        members = [member for member in fleet.members if member.name in requests]
        names = [member.name for member in members]
        with FleetProgress("flying", names, quiet=options.json) as board:
            flights = _Flights(hubs, options, board, arrive, follow=not no_wait)
            with _note_interrupt(flights.accepted):
                flights.fly(members, places, requests)
        answers, problems = flights.answers, flights.problems
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
    states = hubs.ask(fleet.members, lambda _, client: client.latest(STATE).goal, all_or_none=True)
    if states.problems:
        # The centre depends on every vehicle.
        raise no_vehicle_sent(states.problems, [member.name for member in fleet.members])
    return about(states.answers, target.at)


def _request(name: str, place: Position, target: FleetGoal, *, replace: bool) -> GotoRequest:
    try:
        # A vehicle that is still on its way elsewhere passes first.
        return goal_of(place.x, place.y, place.z, replace=replace, wait=True)
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


class _Flights:
    """Flights of all vehicles, hub by hub at the same time: one that is away delays no other."""

    def __init__(
        self,
        hubs: Hubs,
        options: Options,
        board: FleetProgress,
        arrive: float | None,
        *,
        follow: bool,
    ) -> None:
        self._hubs, self._options, self._board = hubs, options, board
        self._arrive, self._follow = arrive, follow
        self.accepted: list[str] = []
        """Names of the vehicles that have accepted their goals so far."""
        self.answers: dict[str, Flight] = {}
        """Last flight of each vehicle that answered."""
        self.problems: dict[str, QuadctlError] = {}
        self._closest: Closest | None = None

    def fly(
        self, members: list[Member], places: Places, requests: Mapping[str, GotoRequest]
    ) -> None:
        """Fly all to their places; fill `answers` and `problems`. Raise Refused if nobody can be sent."""
        groups: dict[str, list[Member]] = {}
        for member in members:
            groups.setdefault(member.connect, []).append(member)
        done = ask_each(groups, lambda connect: self._fly_group(groups[connect], places, requests))
        if len(groups) == 1:
            done.fail()
        for connect, problem in done.problems.items():
            self.problems |= {member.name: problem for member in groups[connect]}
        if not self._options.json and self._follow:
            self._print_arrivals(members)

    def _fly_group(
        self, members: list[Member], places: Places, requests: Mapping[str, GotoRequest]
    ) -> None:
        replace = any(request.replace for request in requests.values())
        try:
            course = course_of(self._hubs, members, places, self._options.timeout, replace=replace)
        except (Unreachable, TimedOut) as problem:
            self.problems |= {member.name: problem for member in members}
            return
        self.problems |= course.silent
        answering = [member for member in members if member.name not in course.silent]
        if course.is_ordered:
            self._fly_in_order(answering, course)
        else:
            self._fly_at_once(answering, requests)

    def _fly_at_once(self, members: list[Member], requests: Mapping[str, GotoRequest]) -> None:
        def ask(member: Member, client: Client) -> Flight:
            left, client.timeout = client.timeout, self._options.timeout
            flight = Flight(client, requests[member.name], left)
            if flight.accepted:
                self.accepted.append(member.name)
            return flight

        results = self._hubs.ask(members, ask)
        self.problems |= results.problems
        for name, flight in results.answers.items():
            self.answers[name] = flight
            verdict = "accepted" if flight.accepted else f"rejected: {flight.reason}"
            if not self._options.json:
                output.line(f"{name}: {verdict}")
            if not flight.accepted:
                ours = flight.refusal().hint.replace("quadctl hold", "quadctl fleet hold")
                hint = ours if flight.reason.startswith(("busy", "separation")) else _WHY
                self.problems[name] = Refused(flight.reason, hint)
        flying = [m for m in members if (one := self.answers.get(m.name)) and one.accepted]
        if flying and self._follow:
            watched = self._hubs.ask(flying, lambda member, _: self._watch(member.name))
            self.problems |= watched.problems

    def _fly_in_order(self, members: list[Member], course: Course) -> None:
        if not self._follow and course.has_points_between:
            raise UsageError(
                "--no-wait: some vehicles fly by points between, which this command has to follow",
                "leave out --no-wait",
            )
        quiet = self._options.json
        if not quiet:
            output.note(course.summary)
        with Distances(course.keeps) as distances:

            def fly(member: Member, client: Client) -> None:
                client.timeout = self._options.timeout
                distances.watch(member.name, client)
                course.fly(member.name, client, partial(self._begin, member.name))

            self.problems |= self._hubs.ask(members, fly).problems
        # Faster than real time, poses are too old on arrival.
        if course.in_real_time and self._follow:
            self._closest = distances.closest

    def _begin(self, name: str, flight: Flight) -> None:
        """Take an accepted flight, and wait for its end."""
        first = name not in self.answers
        self.answers[name] = flight
        if first:
            self.accepted.append(name)
            if not self._options.json:
                output.line(f"{name}: accepted")
        if self._follow:
            self._watch(name)

    def _watch(self, name: str) -> None:
        flight = self.answers[name]
        whole = max(flight.begin(), 1e-6)
        flight.wait(self._arrive, lambda left: self._board.fly(name, left, whole))
        self._board.fly(name, 0.0, whole)

    def _print_arrivals(self, members: list[Member]) -> None:
        for member in members:
            flight = self.answers.get(member.name)
            if flight and flight.arrived and member.name not in self.problems:
                way = f"within {flight.distance:.2f} m after {flight.seconds:.2f} s"
                output.line(f"{member.name}: arrived {way}")
        if near := self._closest:
            pair = " and ".join(near.names)
            kept = f"{near.metres:.2f} m, {near.share:.2f} of what they keep"
            output.line(f"least distance: {pair}, {kept}")
