"""Flights of several vehicles in a box too small for comfort, kept apart by the real traffic."""

import random
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import combinations
from math import inf, sqrt

from quadctl.cli.fleet.plan import Leg, Space, plan
from quadctl.schemas.messages import Position
from quadctl.schemas.params import CageParams, DynamicsParams, SafetyParams
from quadctl.services.airspace.geometry import Point
from quadctl.services.runtime.errors import Refused
from quadctl.services.safety.traffic import Traffic
from tests.support.bodies import dynamics_of, random_body
from tests.support.evolved import evolve
from tests.support.monitored_vehicle import LOOKS, MonitoredVehicle, land, periods, random_height

SIZE, HEIGHT = 1.5, 2.5
ACROSS, TALL = 0.6, 0.9


class FleetFlight:
    """Vehicles in flight, and the least distance of any two at any look; 1 is what is allowed."""

    def __init__(
        self,
        *starts: Position,
        size: float = SIZE,
        height: float = HEIGHT,
        bodies: Sequence[DynamicsParams] = (),
    ) -> None:
        traffic = Traffic()
        self.members = [
            MonitoredVehicle(
                SafetyParams(virtual_cage=CageParams(size, size, height), takeoff=0.0),
                start, f"uav{n}", traffic, bodies[n] if bodies else None,
            )
            for n, start in enumerate(starts)
        ]  # fmt: skip
        self.nearest, self.verdicts = inf, {"flies": 0, "waits": 0, "refused": 0}
        self.fly(0.1)

    def goto(self, n: int, goal: Position, *, replace: bool = False, wait: bool = False) -> str:
        reason = self.members[n].monitor.goto(goal, replace=replace, wait=wait)
        how = "waits" if reason.startswith("waits") else "refused" if reason else "flies"
        self.verdicts[how] += 1
        return reason

    @property
    def is_done(self) -> bool:
        return all(member.is_done for member in self.members)

    def fly(self, seconds: float) -> "FleetFlight":
        for _ in periods(seconds):
            self.period()
        return self

    def land(self) -> "FleetFlight":
        land(self.period, lambda: self.is_done)
        return self

    def period(self) -> None:
        for member in self.members:
            member.see()
        for member in self.members:
            member.obey()
        for _ in range(LOOKS):
            for member in self.members:
                member.advance()
            places = [member.vehicle.position for member in self.members]
            self.nearest = min(self.nearest, *(apart(a, b) for a, b in combinations(places, 2)))


def fly_plan(
    flight: FleetFlight, legs: Sequence[Leg], on_period: Callable[[], None] = lambda: None
) -> None:
    """Fly the legs of a plan for `uav0`, `uav1` .., each as soon as it may be sent."""
    left = {
        n: [k for k, leg in enumerate(legs) if leg.vehicle == f"uav{n}"]
        for n in range(len(flight.members))
    }
    sent: dict[int, int] = {}
    """Vehicle of each leg that was sent, by the number of the leg."""
    for _ in periods(600):
        for n, numbers in left.items():
            # Ways are straight from rest alone, as long as a vehicle takes to respond.
            member = flight.members[n]
            rested = member.monitor.world().rested >= member.law.settling
            if numbers and member.is_done and rested:
                leg = legs[numbers[0]]
                waiting = {k for k, m in sent.items() if flight.members[m].monitor.held}
                if all(k in sent and k not in waiting for k in leg.after):
                    reason = flight.goto(n, Position(*leg.end), wait=True)
                    assert not reason or reason.startswith("waits"), (n, leg, reason)
                    sent[numbers.pop(0)] = n
        flight.period()
        on_period()
        if not any(left.values()) and flight.is_done:
            return
    raise AssertionError(f"not all have arrived: {left}")


def random_plan(seed: int) -> tuple[str, float]:
    """Plan and fly random goals of 3 to 7 vehicles; return what came of it, and the least distance."""
    draws = random.Random(seed)
    starts = random_starts(draws, draws.randint(3, 7))
    changed = draws.random() < 0.3
    goals = draws.sample(starts, len(starts)) if changed else random_starts(draws, len(starts))

    def is_free(_name: str, a: Point, b: Point) -> bool:
        return all(abs(p[0]) <= SIZE and abs(p[1]) <= SIZE and 0 <= p[2] <= HEIGHT for p in (a, b))

    space = Space(ACROSS, TALL, (-SIZE, -SIZE, 0.0), (SIZE, SIZE, HEIGHT), is_free)
    places, ends = (
        {f"uav{n}": (p.x, p.y, p.z) for n, p in enumerate(spots)} for spots in (starts, goals)
    )
    try:
        legs = plan(places, ends, space)
    except Refused:
        return "refused", inf
    flight = FleetFlight(*starts)
    try:
        fly_plan(flight, legs)
    except AssertionError as error:
        return f"seed {seed} failed: {error}", flight.nearest
    return "flown", flight.nearest


def random_plans(seeds: range) -> tuple[Counter[str], float]:
    """Return how often each came of random plans, and the least distance of any two vehicles."""
    found = [random_plan(seed) for seed in seeds]
    return Counter(how for how, _ in found), min(nearest for _, nearest in found)


def apart(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the distance of two places in the measure of separation."""
    dx, dy, dz = (p - q for p, q in zip(a, b, strict=True))
    return sqrt((dx * dx + dy * dy) / ACROSS**2 + dz * dz / TALL**2)


def _somewhere(draws: random.Random) -> Position:
    x, y = draws.uniform(-SIZE, SIZE), draws.uniform(-SIZE, SIZE)
    return Position(x, y, random_height(draws, HEIGHT))


def random_starts(draws: random.Random, count: int) -> list[Position]:
    """Return places that are apart."""
    starts: list[Position] = []
    while len(starts) < count:
        place = _somewhere(draws)
        points = ((p.x, p.y, p.z) for p in starts)
        if all(apart((place.x, place.y, place.z), point) > 1.05 for point in points):
            starts.append(place)
    return starts


def random_flight(
    draws: random.Random, count: int = 10, bodies: Sequence[DynamicsParams] = ()
) -> FleetFlight:
    """Fly at random: goals that wait or not, changes of course, holds; end when all stand still."""
    flight = FleetFlight(*random_starts(draws, count), bodies=bodies)
    for _ in range(draws.randint(10, 40)):
        n = draws.randrange(count)
        flight.goto(n, _somewhere(draws), replace=draws.random() < 0.5, wait=draws.random() < 0.7)
        if draws.random() < 0.1:
            flight.members[draws.randrange(count)].monitor.hold()
        flight.fly(draws.choice((0.05, 0.1, 0.3, 1.0)))
    return flight.land()


def worst(seeds: range) -> tuple[float, dict[str, int], int]:
    """Return the least distance of all flights, the verdicts, and the seed of the nearest."""
    nearest, at = inf, 0
    verdicts: dict[str, int] = {}
    for seed in seeds:
        flight = random_flight(random.Random(seed))
        if flight.nearest < nearest:
            nearest, at = flight.nearest, seed
        for verdict, count in flight.verdicts.items():
            verdicts[verdict] = verdicts.get(verdict, 0) + count
    return nearest, verdicts, at


def search(evaluations: int, island: int = 0) -> float:
    """Return the least distance of two soft vehicles of the table in so many flights; 1 is what is allowed."""

    def rank(draws: random.Random) -> float:
        bodies = [dynamics_of(random_body(draws, soft=True)) for _ in range(2)]
        return random_flight(draws, 2, bodies).nearest

    return evolve(rank, evaluations, island)
