"""Broken automata and monitors: the campaign's own oracle detects each, without looking inside."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from quadctl.schemas.messages import CageSize
from quadctl.services.airspace import cage, stopping
from quadctl.services.airspace.geometry import Point
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.safety import automaton, motion
from quadctl.services.safety.model import FlightPhase
from quadctl.services.safety.monitor import Monitor, TrackingMonitor
from tests.support.campaign_flights import inject, missions
from tests.support.compiled import compiled_kernel

FLIGHTS, PART = 2000, 40
"""Flights in which a broken safety must be detected, and flights flown at once."""

Breaks = Callable[[pytest.MonkeyPatch], None]
why_outside, stopped = cage.why_outside, automaton._stopped


def condition(name: str, when: Callable[..., bool]) -> Breaks:
    """Return what replaces a condition of the rules."""
    return lambda patch: inject(
        patch, lambda rule: rule._replace(when=when) if rule.when.__name__ == name else rule
    )


def action(name: str, do: Callable[..., Any]) -> Breaks:
    """Return what replaces an action of the rules."""
    return lambda patch: inject(
        patch, lambda rule: rule._replace(do=do) if rule.do.__name__ == name else rule
    )


def function(owner: object, name: str, new: Callable[..., Any]) -> Breaks:
    """Return what replaces a function or a method."""
    return lambda patch: patch.setattr(owner, name, new)


def outside_with(size: Callable[[CageSize], CageSize]) -> Breaks:
    """Return what decides by another cage."""
    return function(motion, "why_outside", lambda point, cage: why_outside(point, size(cage)))


def outside_or_on_a_wall(point: Point, size: CageSize) -> str:
    walls = ((-size.x, size.x), (-size.y, size.y), (0.0, size.z))
    on = any(value in pair for value, pair in zip(point, walls, strict=True))
    return "outside the cage: on a wall" if on else why_outside(point, size)


def jumped(speeds: float, margins: float) -> Breaks:
    """Return what takes a pose for a jump at other multiples of the speed and the margin."""

    def when(s: Any, e: Any, w: Any) -> bool:
        params = replace(w.params, max_speed=speeds * w.params.max_speed)
        return automaton.jumped(s, e, replace(w, params=params, margin=margins * w.margin))

    return condition("jumped", when)


def loses(patch: pytest.MonkeyPatch) -> None:
    """Go on relying on a pose that was lost."""
    lose = Monitor.lose

    def lose_but_rely(self: Monitor) -> None:
        lose(self)
        self.fresh = True

    patch.setattr(Monitor, "lose", lose_but_rely)


def observes(gap: float | None, stuck: bool | None) -> Breaks:
    """Return what overlooks gaps, or a vehicle that stands still."""
    observe = TrackingMonitor.observe

    def overlook(self: TrackingMonitor, *args: Any, **more: Any) -> tuple[float, bool]:
        found = observe(self, *args, **more)
        return (found[0] if gap is None else gap), (found[1] if stuck is None else stuck)

    return function(TrackingMonitor, "observe", overlook)


class Forgetful(set[str]):
    """Set that keeps nothing."""

    def add(self, _element: str) -> None:
        pass


def forget_boots(patch: pytest.MonkeyPatch) -> None:
    """Remember no boot that is over."""
    start = Monitor.__init__

    def start_forgetful(self: Monitor, *args: Any, **more: Any) -> None:
        start(self, *args, **more)
        self._void = Forgetful()

    patch.setattr(Monitor, "__init__", start_forgetful)


def toggle_only(s: Any, e: Any, _w: Any) -> Any:
    return replace(s, cage_on=e.cage_on)


BROKEN: dict[str, Breaks] = {
    "no upper bound in z": outside_with(lambda size: replace(size, z=1e9)),
    "bounds 1 mm too far": outside_with(
        lambda size: CageSize(size.x + 0.001, size.y + 0.001, size.z + 0.001)
    ),
    "an open boundary": function(motion, "why_outside", outside_or_on_a_wall),
    "a stop that does not brake": function(
        automaton,
        "_stopped",
        lambda s, w, reason: replace(stopped(s, w, reason), phase=FlightPhase.HOLDING),
    ),
    "a settled stop that keeps its goal": action(
        "settle", lambda s, _e, _w: replace(s, phase=FlightPhase.STOPPED)
    ),
    "barred ignores a flight that has arrived": condition(
        "barred",
        lambda s, e, w: s.state is not automaton.HOVERING and automaton.barred(s, e, w),
    ),
    "straying is always false": condition("straying", lambda _s, _e, _w: False),
    "half the stopping distance": function(
        stopping,
        "soonest_stop",
        lambda pose, limit, *more, of=stopping.soonest_stop: of(pose, 2 * limit, *more),
    ),
    "no ratchet on the way back": action("follow", automaton.keep),
    "toggling forgets beyond": action("toggle", toggle_only),
    "no margin in jumped": jumped(1.0, 0.0),
    "twice the speed in jumped": jumped(2.0, 1.0),
    "a lost pose stays fresh": loses,
    "watch never loses": function(Monitor, "lose", lambda _self: None),
    "gaps of setpoints are overlooked": observes(0.0, None),
    "a standstill is overlooked": observes(None, False),
    "boots that are over are forgotten": forget_boots,
}


def flights_until_detected() -> int | None:
    """Return after how many flights a violation is found, None if it is not."""
    module = compiled_kernel()
    for first in range(0, FLIGHTS, PART):
        # Without faults a sound vehicle must not be stopped; with them a broken one must.
        some = missions(range(first, first + PART), 60.0, faults=first >= PART)
        flown = Batch(some, lambda params: Compiled(params, module)).fly()
        found = [number for number, flight in enumerate(flown, 1) if flight.violations]
        if found:
            return first + found[0]
    return None


@pytest.mark.thorough
@pytest.mark.parametrize("name", BROKEN)
def test_the_campaign_detects_a_broken_safety(monkeypatch: pytest.MonkeyPatch, name: str):
    BROKEN[name](monkeypatch)
    assert flights_until_detected() is not None


@pytest.mark.thorough
def test_the_campaign_finds_no_fault_in_the_sound_safety():
    module = compiled_kernel()
    some = [*missions(range(60), 60.0), *missions(range(60, 200), 60.0, faults=True)]
    flown = Batch(some, lambda params: Compiled(params, module)).fly()
    assert [flight.violations for flight in flown if flight.violations] == []
