"""Formation: vehicles of a process that fly at the same ticks, all in one go.

A tick of its own costs a vehicle as much as its flight, and a flight alone three times as much as one of many.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Protocol

from quadctl.schemas.topics import POSE_SLOW
from quadctl.services.dynamics.compiler import BackgroundCompiler
from quadctl.services.dynamics.controller import STEPS
from quadctl.services.dynamics.vehicle import Vehicle

_IDLE = 1.0
"""Ticks a second of a formation without vehicles."""


class Loop(Protocol):
    """Loop of a vehicle's node, as far as a formation needs it."""

    def take_turn(self) -> bool:
        """Let nothing else run until `end_turn`; return False, and do nothing, if the loop is not idle."""

    def end_turn(self) -> None:
        """End the turn that `take_turn` began."""

    def poll(self) -> None:
        """Handle the messages that have come."""

    def post(self, item: Callable[[], None]) -> None:
        """Run an item soon."""


class FormationMember(Protocol):
    """Vehicle's simulation, as far as a formation needs it."""

    vehicle: Vehicle

    @property
    def executor(self) -> Loop:
        """Return the loop of the vehicle's node."""

    @property
    def beats(self) -> bool:
        """Return whether its poses are the beats of its process."""

    @property
    def rests(self) -> bool:
        """Return whether the vehicle repeats its pose until it gets another setpoint."""

    def flights(self, now: float) -> Iterator[int]:
        """Yield how many steps to fly, for the caller to do so, up to a time (monotonic s)."""

    def fly(self, now: float) -> None:
        """Fly up to a time (monotonic s), alone."""


Every = Callable[[Callable[[], float], Callable[[float], None]], Callable[[], None]]
"""`Executor.every_together` of the vehicles' process."""


def _fly_alone(member: FormationMember, now: float) -> None:
    member.executor.poll()
    member.fly(now)


class Formation:
    """Vehicles that fly together; each comes and goes as its rate and its rests make it."""

    def __init__(self, every: Every, compiler: BackgroundCompiler) -> None:
        """Begin without vehicles; tick by `every`."""
        self._compiler = compiler
        self._members: dict[FormationMember, None] = {}
        """Vehicles, first the one with the poses by which the others count their periods at rest."""
        self._retime = every(lambda: POSE_SLOW.hz if self._members else _IDLE, self._tick)

    def __contains__(self, member: FormationMember) -> bool:
        """Return whether a vehicle flies at these ticks."""
        return member in self._members

    def add(self, member: FormationMember) -> None:
        """Fly a vehicle from the next tick on."""
        if not self._members:
            self._retime()
        others, one = self._members, {member: None}
        self._members = one | others if member.beats else others | one

    def remove(self, member: FormationMember) -> None:
        """Leave a vehicle to its own ticks."""
        self._members.pop(member, None)

    def _tick(self, now: float) -> None:
        members = list[FormationMember]()
        for each in self._members:
            if each.executor.take_turn():
                members.append(each)
            else:
                each.executor.post(partial(_fly_alone, each, now))
        try:
            flights = list[tuple[Vehicle, Iterator[int]]]()
            for each in members:
                each.executor.poll()
                if each.beats:
                    each.fly(now)
                else:
                    flights.append((each.vehicle, each.flights(now)))
            while due := [
                (vehicle, flight, steps)
                for vehicle, flight in flights
                if (steps := next(flight, 0))
            ]:
                self._advance((vehicle, steps) for vehicle, _, steps in due)
                flights = [(vehicle, flight) for vehicle, flight, _ in due]
        finally:
            for each in members:
                each.executor.end_turn()
        for each in members:
            if each.rests:
                self.remove(each)

    def _advance(self, flights: Iterable[tuple[Vehicle, int]]) -> None:
        """Fly vehicles for so many steps each; those alike as one."""
        model, alike = self._compiler.model, dict[tuple[int, int, int], list[Vehicle]]()
        for vehicle, steps in flights:
            if vehicle.is_still or model is None:
                vehicle.advance(steps)
            else:
                kind = id(vehicle.constants), vehicle.steps % STEPS, steps
                alike.setdefault(kind, []).append(vehicle)
        for (_, start, steps), vehicles in alike.items():
            assert model is not None  # noqa: S101 - else nothing is alike
            lanes = model.fly([each.lane for each in vehicles], vehicles[0].constants, start, steps)
            for vehicle, lane in zip(vehicles, lanes, strict=True):
                vehicle.take(lane, steps)
