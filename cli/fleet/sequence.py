"""Sequence: gathers what the plan of a fleet's flights needs, and flies its legs in their order."""

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from math import dist, sqrt
from threading import Event, Thread
from typing import Any, Self

from msgspec import Struct
from msgspec.structs import astuple

from quadctl.cli.fleet.file import Member
from quadctl.cli.fleet.hubs import Hubs
from quadctl.cli.fleet.plan import Leg, Space, plan
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState
from quadctl.schemas.params import Params, SeparationParams
from quadctl.schemas.services import GetParamsRequest, HoldRequest
from quadctl.schemas.topics import HOLD, POSE_SLOW, STATE, get_params
from quadctl.schemas.typed import converted
from quadctl.schemas.zones import FARTHEST
from quadctl.services.airspace.airworthiness import stopping_law
from quadctl.services.airspace.cage import bounds, why_outside
from quadctl.services.airspace.geometry import Piece, Point, around, distance, place_of
from quadctl.services.airspace.routes import NEAR
from quadctl.services.airspace.stopping import AT_REST, StoppingLaw
from quadctl.services.airspace.zones import Region
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.streams import TypedSubscriber
from quadctl.services.runtime.errors import QuadctlError, Refused, TimedOut, Unreachable
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import put
from quadctl.vehicle import Flight, goal_of, slowed

_LOOK = 0.05
"""Seconds between two looks at the vehicles' distances."""


_STOPPING = 4.0
"""Seconds to come to rest; in gusts a vehicle never does, and flies from where it is."""


class Known(Struct, frozen=True):
    """A vehicle's pose, its goal (m) in flight, its stop, what it has to keep to, and if its clock may wait."""

    pose: Pose
    flies_to: Position | None
    law: StoppingLaw
    separation: SeparationParams
    cage: CageSize
    region: Region
    lockstep: bool

    @property
    def place(self) -> Point:
        """Return where (m) the vehicle is, or soon will be."""
        return astuple(self.flies_to or self.pose.position)


def course_of(
    hubs: Hubs,
    members: Sequence[Member],
    goals: Mapping[str, Position],
    timeout: float,
    *,
    replace: bool,
) -> "Course":
    """Return the flights that bring vehicles of one hub to their goals, apart from all others there.

    A vehicle that does not answer within the timeout (s) has its error in `silent`, and no flight.
    Raises Refused if there is no plan, and what a Client raises for a hub that is away.
    With `replace`, vehicles in flight change course; where their ways, which bend, may meet others,
    they come to rest first.
    """
    connect, names = members[0].connect, {member.vehicle: member.name for member in members}
    there = hubs.client(connect, members[0].vehicle, timeout).vehicles()
    everyone = [
        Member(names.get(vehicle, vehicle), connect, vehicle)
        for vehicle in dict.fromkeys([*names, *there])
    ]
    ends = {name: astuple(goals[name]) for name in names.values()}
    if len(everyone) == 1:
        return Course(_planned({}, ends), {}, {}, replace=replace)
    found = hubs.ask(everyone, lambda _, client: _known(client, replace=replace))
    known = dict(found.answers)
    # A second wait for their flights would double the timeout.
    silent = {
        name: problem
        for name, problem in found.problems.items()
        if name in ends and isinstance(problem, (TimedOut, Unreachable))
    }
    ends = {name: end for name, end in ends.items() if name not in silent}
    if replace and (bent := _bent(known, ends)):
        stop = [member for member in everyone if member.name in bent]
        known |= hubs.ask(stop, lambda _, client: _stopped(client)).answers
    return Course(_planned(known, ends), known, silent, replace=replace)


def _bent(known: Mapping[str, Known], goals: Mapping[str, Point]) -> set[str]:
    """Return the vehicles in flight that are to change course, if the bent way of one may meet another way."""
    apart = {name: one for name, one in known.items() if one.separation.radius}
    flying = {name for name in goals.keys() & apart.keys() if apart[name].flies_to}
    across, tall = _keeps([*apart.values()])
    ways = {name: _way(one, goals.get(name, one.place)) for name, one in apart.items()}
    meet = any(
        distance((ways[name],), (way,), across, tall) < 1
        for name in flying
        for other, way in ways.items()
        if other != name
    )
    return flying if meet else set()


def _way(one: Known, goal: Point) -> Piece:
    """Return the box of a vehicle's way, wherever it turns or stops."""
    ends = [place_of(one.pose), goal]
    if one.flies_to:
        ends += [*one.law.box(one.pose), one.place]
    return Piece(*around(*ends), is_box=True)


def _stopped(client: Client) -> Known:
    client.call(HOLD, HoldRequest())
    return _known(client, replace=True)


def _keeps(known: Sequence[Known]) -> tuple[float, float]:
    """Return the distances (m) that vehicles keep from each other: across and tall."""
    kept = [one.separation for one in known] or [SeparationParams()]
    return max(2 * one.radius for one in kept), max(one.height for one in kept)


def _known(client: Client, *, replace: bool) -> Known:
    state, pose, ends = client.latest(STATE), client.first(POSE_SLOW), time.monotonic() + _STOPPING
    # A flight straight up, e.g. a take-off, ends soon, and from rest a way is straight.
    while not replace and _rises(state, pose) and time.monotonic() < ends:
        time.sleep(_LOOK)
        state, pose = client.latest(STATE), client.first(POSE_SLOW)
    params = _params(client)
    safety, law = params.safety, _law_of(params)
    cage = state.cage if state.cage_on else CageSize(FARTHEST, FARTHEST, FARTHEST)
    zones = safety.zones if state.cage_on else []
    flies_to = state.goal if state.state == "MOVING" else None
    if not flies_to:
        pose = _settled(client, law, _STOPPING)
    region, lockstep = Region(zones), params.dynamics.in_lockstep
    return Known(pose, flies_to, law, safety.separation, cage, region, lockstep)


def settled(client: Client, within: float) -> Pose:
    """Return the pose at which a vehicle has stopped for good, or the newest one after `within` s."""
    return _settled(client, _law_of(_params(client)), within)


def _settled(client: Client, law: StoppingLaw, within: float) -> Pose:
    # From rest a way is straight, to safety, too: its last command may have come just now.
    rest = law.settling_after_command
    return slowed(client, AT_REST, within, rest) or client.first(POSE_SLOW)


def _params(client: Client) -> Params:
    """Return the parameters that a vehicle's safety and dynamics have declared."""
    declared: dict[str, Any] = {}
    for node in ("safety", "dynamics"):
        values = client.call(get_params(node), GetParamsRequest([node])).values
        for name, value in catalogue.declared(values).items():
            put(declared, name, value, node)
    return converted(declared, Params)


def _law_of(params: Params) -> StoppingLaw:
    flown, safety = params.dynamics, params.safety
    law = stopping_law(flown.vehicle, flown.control, flown.wind)
    return law.declared(safety.reaction, safety.max_acceleration, safety.min_deceleration)


def _rises(state: SafetyState, pose: Pose) -> bool:
    x, y, _ = place_of(pose)
    return state.state == "MOVING" and dist((x, y), (state.goal.x, state.goal.y)) < NEAR


def _planned(known: Mapping[str, Known], goals: Mapping[str, Point]) -> list[Leg]:
    apart = {name: one for name, one in known.items() if one.separation.radius}
    ends = {name: goal for name, goal in goals.items() if name in apart and len(apart) > 1}
    free_to_fly = [Leg(name, goal, goal, ()) for name, goal in goals.items() if name not in ends]
    if not ends:
        return free_to_fly
    across, tall = _keeps([*apart.values()])
    boxes = [[*bounds(one.cage).values()] for one in apart.values()]
    lows, highs = zip(*(zip(*box, strict=True) for box in boxes), strict=True)
    x0, y0, z0 = (max(column) for column in zip(*lows, strict=True))
    x1, y1, z1 = (min(column) for column in zip(*highs, strict=True))

    def free(name: str, a: Point, b: Point) -> bool:
        one = apart[name]
        barred = one.region.why_inside(b) or one.region.why_crosses(a, b)
        return not (why_outside(b, one.cage) or barred)

    space = Space(across, tall, (x0, y0, z0), (x1, y1, z1), free)
    return [*plan({name: one.place for name, one in apart.items()}, ends, space), *free_to_fly]


class Course:
    """Flights of a plan: each leg is sent after those that have to begin before it."""

    def __init__(
        self,
        legs: Sequence[Leg],
        known: Mapping[str, Known],
        silent: Mapping[str, QuadctlError],
        *,
        replace: bool,
    ) -> None:
        """Take the legs of a plan, what is known of the vehicles, and who is silent; see `course_of`."""
        self.silent = silent
        """Errors of the vehicles without an answer, by name."""
        self._legs, self._replace = legs, replace
        self._begun = [Event() for _ in legs]
        self._failed: set[str] = set()
        self.keeps = _keeps([*known.values()])
        self._rests = {name: one.law.settling_after_command for name, one in known.items()}
        self.in_real_time = not any(one.lockstep for one in known.values())

    @property
    def is_ordered(self) -> bool:
        """Return whether any vehicle waits for others, or flies by points between."""
        return self.has_points_between or any(leg.after for leg in self._legs)

    @property
    def has_points_between(self) -> bool:
        """Return whether a vehicle has several legs."""
        return len(self._legs) > len({leg.vehicle for leg in self._legs})

    @property
    def summary(self) -> str:
        """Return how many vehicles wait for others, and how many fly by points between."""
        flown = [leg.vehicle for leg in self._legs]
        waits = len({leg.vehicle for leg in self._legs if leg.after})
        around = sum(flown.count(name) > 1 for name in set(flown))
        return f"to keep apart, {waits} of {len(set(flown))} wait for others, {around} fly by points between"

    def fly(
        self,
        name: str,
        client: Client,
        follow: Callable[[Flight], object],
    ) -> None:
        """Fly a vehicle's legs; raise what a flight raises, and Refused if one before it failed.

        `follow` is called with each flight that safety accepts, and returns at its arrival.
        """
        own = [number for number, leg in enumerate(self._legs) if leg.vehicle == name]
        try:
            for number in own:
                first = number == own[0]
                if not first:  # only from rest is a way as straight as planned
                    slowed(client, AT_REST, _STOPPING, self._rests[name])
                follow(self._begin(number, client, replace=self._replace and first))
        except BaseException:
            self._failed.add(name)
            raise
        finally:
            for number in own:
                self._begun[number].set()

    def _begin(self, number: int, client: Client, *, replace: bool) -> Flight:
        leg = self._legs[number]
        for before in leg.after:
            self._wait_for(before)
        flight = Flight(client, goal_of(*leg.end, replace=replace, wait=True))
        if not flight.accepted:
            raise flight.refusal()
        flight.leave()
        self._begun[number].set()
        return flight

    def _wait_for(self, number: int) -> None:
        self._begun[number].wait()
        before = self._legs[number].vehicle
        if before in self._failed:
            raise Refused(
                f"not sent: {before}, which goes first, failed",
                "`quadctl fleet list` shows all; send the rest again",
            )


class Closest(Struct, frozen=True):
    """Two vehicles at their nearest: metres apart, and as a share of what they have to keep."""

    names: tuple[str, str]
    metres: float
    share: float


class Distances:
    """Least distance of vehicles from each other, for a `with` block: looks at their poses."""

    def __init__(self, keeps: tuple[float, float]) -> None:
        """Take what the vehicles keep, m: across and tall."""
        across, tall = keeps
        self._scale = (1 / (across * across) if across else 0.0), 1 / (tall * tall)
        self._readers: dict[str, TypedSubscriber[Pose]] = {}
        self._seen: dict[str, tuple[float, Pose]] = {}
        self._ended = Event()
        self._thread = Thread(target=self._look, daemon=True)
        self.closest: Closest | None = None

    def watch(self, name: str, client: Client) -> None:
        """Watch one vehicle more; safe to call from any thread."""
        self._readers[name] = client.subscribe(POSE_SLOW)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        for reader in self._readers.values():
            reader.close()

    def _look(self) -> None:
        while not self._ended.wait(_LOOK):
            for name, reader in tuple(self._readers.items()):
                while (pose := reader.next(0)) is not None:
                    self._seen[name] = time.monotonic(), pose
            now = time.monotonic()
            places = {name: _now(pose, now - at) for name, (at, pose) in self._seen.items()}
            for (name, a), (other, b) in combinations(places.items(), 2):
                self._compare(name, a, other, b)

    def _compare(self, name: str, a: Point, other: str, b: Point) -> None:
        flat = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
        up = (a[2] - b[2]) ** 2
        share = flat * self._scale[0] + up * self._scale[1]
        if self.closest is None or share < self.closest.share**2:
            self.closest = Closest((name, other), sqrt(flat + up), sqrt(share))


def _now(pose: Pose, age: float) -> Point:
    """Return the place (m) of a vehicle so many seconds after its pose."""
    p, v = pose.position, pose.velocity
    return p.x + age * v.x, p.y + age * v.y, p.z + age * v.z
