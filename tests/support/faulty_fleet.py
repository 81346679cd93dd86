"""Flights of several vehicles whose goals wait, with faults in between; at the end all land."""

import math
import random

from quadctl.schemas.messages import Position
from quadctl.schemas.topics import SETPOINT
from quadctl.services.safety.model import State
from tests.support.fleet_flights import HEIGHT, SIZE, FleetFlight, random_starts
from tests.support.monitored_vehicle import LOOKS, periods

_PERIOD = 1 / SETPOINT.hz
_SLOW = 0.05
"""Speed (m/s) below which `fleet land-all` sends a vehicle to the ground."""
_FLOOR = 0.02
"""Height (m) of a vehicle that has landed."""
_GRACE = 1.0
"""Time (s) without poses after which nothing waits."""
_LONGEST = 120.0
"""Simulated time (s) after which a fleet that has not come to an end hangs."""


class FaultyFleet(FleetFlight):
    """Fleet of which some vehicles have no poses for a time; `wrong` lists what must not happen."""

    def __init__(self, *starts: Position) -> None:
        self._blind: dict[int, float] = {}
        """Time (s) without poses that is left, negative afterwards, by number."""
        self._age = [0.0] * len(starts)
        self._under_way = [False] * len(starts)
        self.wrong: list[str] = []
        super().__init__(*starts)

    def blind(self, n: int, seconds: float) -> None:
        """Take the poses of a vehicle away for a time, s."""
        self._blind[n] = seconds

    def goto(self, n: int, goal: Position, *, replace: bool = False, wait: bool = False) -> str:
        reason = super().goto(n, goal, replace=replace, wait=wait)
        self._under_way[n] = True
        return reason

    def period(self) -> None:
        for n, member in enumerate(self.members):
            self._blind[n] = left = self._blind.get(n, 0.0) - _PERIOD
            if left <= 0.0:
                self._age[n] = 0.0
                member.see()
            else:
                self._age[n] += _PERIOD
                member.monitor.lose()
                member.monitor.silent(self._age[n])
                if self._age[n] > _GRACE and member.monitor.held:
                    self.wrong.append(f"{member.monitor.name} waits without poses")
        for n, member in enumerate(self.members):
            monitor = member.monitor
            s = monitor.situation
            if s.state is State.MOVING and not self._under_way[n]:
                self.wrong.append(f"{monitor.name} flew off by itself")
            self._under_way[n] = bool(s.state is State.MOVING or s.paused or monitor.held)
            member.obey()
            for _ in range(LOOKS):
                member.advance()

    @property
    def is_over(self) -> bool:
        """Return whether no goal waits or is flown, and every vehicle has poses."""
        return not any(self._under_way) and all(left <= 0.0 for left in self._blind.values())

    def finish(self) -> None:
        """Fly until that is so."""
        for _ in periods(_LONGEST):
            self.period()
            if self.is_over:
                return
        waits = [m.monitor.situation.reason for m in self.members if m.monitor.held]
        self.wrong.append(f"it hangs: {waits}")

    def land_all(self) -> None:
        """Land all as `fleet land-all` does; one that is not on the floor has to have a reason."""
        for member in self.members:
            member.monitor.hold()
        left = set(range(len(self.members)))
        for _ in periods(_LONGEST):
            self.period()
            for n in tuple(left):
                if math.hypot(*self.members[n].vehicle.velocity) < _SLOW:
                    left.remove(n)
                    place = self.members[n].place
                    self.goto(n, Position(place.x, place.y, 0.0), replace=True, wait=True)
            rest = all(
                m.is_done and (m.vehicle.standing or m.vehicle.setpoint_rests) for m in self.members
            )
            if not left and self.is_over and rest:
                break
        else:
            self.wrong.append("the landing hangs")
        for member in self.members:
            if member.place.z > _FLOOR and not member.monitor.situation.reason:
                self.wrong.append(f"{member.monitor.name} hovers at {member.place.z:.2f} m")


def random_flight(seed: int) -> list[str]:
    """Fly at random, then land all; return what went wrong."""
    draws = random.Random(seed)
    count = draws.randint(2, 5)
    fleet = FaultyFleet(*random_starts(draws, count))
    for _ in range(draws.randint(3, 12)):
        n = draws.randrange(count)
        x, y = draws.uniform(-SIZE, SIZE), draws.uniform(-SIZE, SIZE)
        if draws.random() < 0.4:
            x, y = fleet.members[n].place.x, fleet.members[n].place.y
        fleet.goto(
            n,
            Position(x, y, draws.choice((0.0, 0.0, draws.uniform(0, HEIGHT)))),
            replace=draws.random() < 0.3,
            wait=draws.random() < 0.8,
        )
        what = draws.random()
        other = draws.randrange(count)
        if what < 0.1:
            fleet.members[other].monitor.hold()
        elif what < 0.3:
            fleet.blind(other, draws.choice((0.3, 0.8, 2.0, 6.0)))
        elif what < 0.35:
            fleet.members[other].monitor.halted("a fault")
        fleet.fly(draws.choice((0.05, 0.3, 1.0)))
    fleet.finish()
    fleet.land_all()
    return fleet.wrong


def worst(seeds: range) -> list[str]:
    """Return what went wrong in all flights, each with its seed."""
    return [f"{seed}: {what}" for seed in seeds for what in random_flight(seed)]
