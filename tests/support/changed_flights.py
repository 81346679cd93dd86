"""Flights in which the cage or a zone changes, beside their twins that hold in that instant."""

import random
from math import hypot
from typing import NamedTuple

from msgspec.structs import astuple

from quadctl.schemas.messages import CageSize, Position
from quadctl.schemas.params import CageParams, DynamicsParams, SafetyParams
from quadctl.schemas.zones import ZoneParams
from quadctl.services.airspace.stopping import outside
from quadctl.services.airspace.zones import Region
from tests.support.bodies import dynamics_of, random_body
from tests.support.evolved import evolve
from tests.support.monitored_vehicle import LOOKS, MonitoredVehicle, periods, random_height
from tests.support.zone_flights import random_zone

_WIDE = CageParams(12.0, 12.0, 8.0)
Goals = tuple[tuple[Position, float], ...]


class Change(NamedTuple):
    """Goals, each with the time (s) until the next event, and what is then in force."""

    start: Position
    goals: Goals
    cage: CageParams
    zones: tuple[ZoneParams, ...] = ()
    toggled: bool = False
    body: DynamicsParams | None = None


class _Flight(MonitoredVehicle):
    """Vehicle in a wide cage without zones, or one that is off."""

    def __init__(self, change: Change) -> None:
        self.params = SafetyParams(virtual_cage=_WIDE, takeoff=0.0, cage_on=not change.toggled)
        super().__init__(self.params, change.start, body=change.body)
        self.fly(0.1)
        for goal, seconds in change.goals:
            self.monitor.goto(goal, replace=True)
            self.fly(seconds)
        self.params.virtual_cage, self.params.zones = change.cage, list(change.zones)
        if change.toggled:
            self.monitor.toggle(cage_on=True)
        self.monitor.resize()

    def fly(self, seconds: float) -> float:
        """Fly on, and return the greatest distance (m) out of the cage or into a zone."""
        size, worst = self.params.virtual_cage, 0.0
        cage, region = CageSize(size.x, size.y, size.z), Region(self.params.zones)
        for _ in periods(seconds):
            self.see()
            self.obey()
            for _ in range(LOOKS):
                self.advance()
                place = astuple(self.place)
                worst = max(worst, outside(*place, *astuple(cage)), region.excess(place, place))
        return worst


def farther(change: Change) -> float:
    """Return how much farther (m) out of what is in force the flight gets than its twin."""
    flight = _Flight(change)
    # To the end of any stop.
    law = flight.law
    afterwards = 6.0 + law.response + hypot(*flight.vehicle.velocity) / law.deceleration
    if flight.monitor.situation.brake or not (out := flight.fly(afterwards)):
        return 0.0
    twin = _Flight(change)
    twin.monitor.hold()
    return out - twin.fly(afterwards)


def drawn_change(draws: random.Random, *, soft: bool = False) -> Change:
    """Return a change in a flight that turns, in most cases; its last goal mostly stays permitted.

    With `soft`, a soft vehicle of the table flies it, else the lab's.
    """
    body = dynamics_of(random_body(draws, soft=True)) if soft else None

    def goal(size: float) -> Position:
        x, y = draws.uniform(-size, size), draws.uniform(-size, size)
        return Position(x, y, random_height(draws, size))

    times = [draws.uniform(0.4, 1.6) for _ in range(draws.randint(1, 3))]
    goals = (*((goal(6.0), seconds) for seconds in times), (goal(2.0), draws.uniform(0.05, 0.6)))
    last = goals[-1][0]
    x, y, z = (draws.choice((0.01, 0.1, 0.5, 10.0)) for _ in range(3))
    tight = CageParams(abs(last.x) + x, abs(last.y) + y, max(last.z, 0.2) + z)
    changed = draws.random()
    cage = tight if changed < 0.7 else _WIDE
    count = draws.randint(1, 3) if changed > 0.5 else 0
    zones = tuple(random_zone(draws, number) for number in range(count))
    return Change(goal(3.0), goals, cage, zones, toggled=draws.random() < 0.3, body=body)


def search(evaluations: int, island: int = 0, *, soft: bool = False) -> float:
    """Return the most (m) that any of so many flights gets farther out than its twin."""
    return -evolve(lambda draws: -farther(drawn_change(draws, soft=soft)), evaluations, island)
