"""Flights of the real vehicle model among zones, in step with the real monitor, without a bus."""

import math
import random
from math import inf

from msgspec.structs import astuple

from quadctl.schemas.messages import Position
from quadctl.schemas.params import CageParams, DynamicsParams, SafetyParams
from quadctl.schemas.zones import CircleParams, ZoneParams
from quadctl.services.airspace.zones import Region
from tests.support.bodies import dynamics_of, random_body
from tests.support.evolved import evolve
from tests.support.monitored_vehicle import LOOKS, MonitoredVehicle, land, periods, random_height

SIZE, HEIGHT = 6.0, 4.0


class ZoneFlight(MonitoredVehicle):
    """Vehicle at (0, 0, 1) whose depth in zones is measured at each look."""

    watches = False

    def __init__(
        self, *zones: ZoneParams, start: Position | None = None, body: DynamicsParams | None = None
    ) -> None:
        self.params = SafetyParams(
            virtual_cage=CageParams(SIZE, SIZE, HEIGHT), zones=list(zones), takeoff=0.0
        )
        super().__init__(self.params, start or Position(0.0, 0.0, 1.0), body=body)
        self.deepest, self.verdicts = 0.0, {True: 0, False: 0}
        self.nearest = inf
        """Least distance (m) from a zone in a period, if the flight `watches` it."""
        self._region, self._surprised = Region(zones), False
        self.fly(0.2)

    @property
    def rank(self) -> float:
        """Return the metres that were left to a zone, negative inside one."""
        return -self.deepest if self.deepest > 0 else max(self.nearest, 0.0)

    def set_zones(self, *zones: ZoneParams) -> None:
        self.params.zones, self._region = list(zones), Region(zones)
        self.monitor.resize()

    def goto(self, goal: Position, *, replace: bool = False, direct: bool = False) -> str:
        reason = self.monitor.goto(goal, replace=replace, direct=direct)
        self.verdicts[not reason] += 1
        return reason

    def fly(self, seconds: float) -> "ZoneFlight":
        for _ in periods(seconds):
            self._period()
        return self

    def land(self) -> "ZoneFlight":
        """Fly until the vehicle stands still."""
        land(self._period, lambda: self.is_done)
        return self

    def _period(self) -> None:
        self.see()
        self.obey()
        for _ in range(LOOKS):
            self.advance()
            # A zone that came upon the vehicle may keep it for a while; without one, no guard acts.
            beyond = self.monitor.situation.beyond
            self._surprised = beyond > 0 and (beyond < inf or self._surprised)
            if not self._surprised:
                place = astuple(self.place)
                self.deepest = max(self.deepest, self._region.excess(place, place))
        wall = (
            self._region.nearest(astuple(self.place))
            if self.watches and not self.monitor.situation.beyond
            else None
        )
        if wall:
            self.nearest = min(self.nearest, wall.distance)


def random_zone(draws: random.Random, number: int) -> ZoneParams:
    """Return a concave, convex, thin or round zone; some are nested in others, some touch."""
    floor = draws.choice((-10_000.0, 0.0, 0.5, 1.0, 1.5))
    ceiling = draws.choice((10_000.0, 2.0, 2.5, 3.0))
    while True:
        x, y = (draws.choice((round(v), v)) for v in (draws.uniform(-5, 5), draws.uniform(-5, 5)))
        kind = draws.random()
        name = f"z{number}"
        if kind < 0.2:
            circle = CircleParams(float(x), float(y), draws.uniform(0.1, 1.5))
            return ZoneParams(name, circle=circle, floor=floor, ceiling=ceiling)
        if kind < 0.5:
            w, h = draws.choice(((0.02, 3.0), (3.0, 0.02), (1.0, 1.0), (2.0, 1.0)))
            corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
        else:
            angles = sorted(draws.uniform(0, 2 * math.pi) for _ in range(draws.randint(3, 12)))
            reach = [draws.uniform(0.2, 2.0) for _ in angles]
            corners = [
                (x + r * math.cos(a), y + r * math.sin(a))
                for a, r in zip(angles, reach, strict=True)
            ]
        try:
            return ZoneParams(
                name,
                polygon=tuple((float(a), float(b)) for a, b in corners),
                floor=floor,
                ceiling=ceiling,
            )
        except ValueError:
            continue  # its edges cross


def random_flight(seed: int) -> ZoneFlight:
    """Fly the flight of a seed."""
    return drawn_flight(random.Random(seed))


def drawn_flight(
    draws: random.Random, make: type[ZoneFlight] = ZoneFlight, body: DynamicsParams | None = None
) -> ZoneFlight:
    """Fly a drawn flight of some 15 s: goals, changes of course, holds, zones that come and go."""
    zones = [random_zone(draws, n) for n in range(draws.randint(1, 8))]
    region = Region(zones)

    def somewhere() -> Position:
        x, y = draws.uniform(-SIZE, SIZE), draws.uniform(-SIZE, SIZE)
        return Position(x, y, random_height(draws, HEIGHT))

    start = next(p for p in iter(somewhere, None) if not region.why_inside(astuple(p)))
    flight = make(*zones, start=start, body=body)
    for _ in range(draws.randint(3, 7)):
        flight.goto(somewhere(), replace=draws.random() < 0.7, direct=draws.random() < 0.2)
        flight.fly(draws.choice((0.1, 0.5, 1.5, 3.0, 5.0)))
        what = draws.random()
        if what < 0.15:
            flight.monitor.hold()
        elif what < 0.2:
            flight.set_zones(*zones, random_zone(draws, 99))
        elif what < 0.25:
            flight.set_zones(*zones)
    return flight.land()


def worst(seeds: range) -> tuple[float, dict[bool, int], int]:
    """Return the deepest metres in any zone, the verdicts, and the seed of the deepest flight."""
    deepest, verdicts, at = -inf, {True: 0, False: 0}, 0
    for seed in seeds:
        flight = random_flight(seed)
        if flight.deepest > deepest:
            deepest, at = flight.deepest, seed
        for verdict, count in flight.verdicts.items():
            verdicts[verdict] += count
    return deepest, verdicts, at


class _Watched(ZoneFlight):
    watches = True


def search(evaluations: int, island: int = 0, *, soft: bool = False) -> tuple[float, float]:
    """Return the greatest depth (m) and the least distance (m) of so many flights.

    The ones that came deepest, or else nearest, are varied; each `island` has its own. With `soft`, each has
    a soft vehicle of the table, else the lab's.
    """
    deepest, nearest = 0.0, inf

    def rank(draws: random.Random) -> float:
        nonlocal deepest, nearest
        body = dynamics_of(random_body(draws, soft=True)) if soft else None
        flight = drawn_flight(draws, _Watched, body)
        deepest, nearest = max(deepest, flight.deepest), min(nearest, flight.nearest)
        return flight.rank

    evolve(rank, evaluations, island)
    return deepest, nearest
