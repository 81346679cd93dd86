"""Flights of a campaign: equal to live ones, free of violations unless a rule is broken."""

from itertools import pairwise, product

import numpy as np
import pytest
from msgspec.structs import replace

from quadctl.schemas.messages import Position
from quadctl.schemas.params import CageParams, DynamicsParams, SafetyParams, StartParams
from quadctl.services.campaign import workers
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import (
    CageEvent,
    Conditions,
    Deaf,
    GotoEvent,
    Mission,
    Mute,
    Resize,
    Stuck,
)
from quadctl.services.campaign.score import Flown
from quadctl.services.campaign.vehicles import Compiled, Plain
from quadctl.services.campaign.workers import Job
from quadctl.services.safety.automaton import Rule, always
from quadctl.services.safety.model import Check, Resized, State, Toggle
from tests.support.campaign_flights import Sleepless, batch, inject, missions
from tests.support.compiled import compiled_kernel
from tests.support.monitor_rig import OUTSIDE, Rig

HALF, TOP = 2.0, 1.5
MIDDLE = (0.0, 0.0, 0.75)
# The sixth side is the floor: nothing can be below it.
SIDES = ((HALF, 0, 0), (-HALF, 0, 0), (0, HALF, 0), (0, -HALF, 0), (0, 0, TOP / 2))
DISTANCES = (0.3, 2.0, 6.0)
ON, BACK, END = 5.0, 5.5, 11.0
STILL = DynamicsParams(start=StartParams(z=1.0))


def mission(side: tuple[float, float, float], distance: float) -> Mission:
    length = sum(map(abs, side))
    x, y, z = (m + s * (1 + distance / length) for m, s in zip(MIDDLE, side, strict=True))
    safety = SafetyParams(cage_on=False, takeoff=0.0, virtual_cage=CageParams(HALF, HALF, TOP))
    rows = (
        GotoEvent(0.0, x, y, z, replace=False),
        CageEvent(ON, on=True),
        GotoEvent(ON, x, y, z, replace=False),
        GotoEvent(BACK, 0.5, -0.5, 0.5, replace=False),
    )
    return Mission(0, END, safety, DynamicsParams(start=StartParams(*MIDDLE)), rows)


@pytest.mark.thorough
def test_a_vehicle_outside_hovers_accepts_goals_inside_and_returns():
    places = list(product(SIDES, DISTANCES))
    batch = Batch([mission(side, distance) for side, distance in places], Plain)
    flown = batch.fly()
    size = np.array([HALF, HALF, TOP])
    for number, ((_, distance), flight) in enumerate(zip(places, flown, strict=True)):
        assert flight.violations == []
        assert flight.refusals == {"outside the cage": 1}
        assert flight.worst_excursion < 0.001
        path = batch._track[:, :3, number]
        outs = np.maximum(np.maximum(path - size, -size * (1, 1, 0) - path), 0.0)
        beyond = np.sqrt((outs * outs).sum(axis=1))
        on, back = round(20 * ON), round(20 * BACK)
        assert beyond[on] == pytest.approx(distance, abs=0.01)
        assert np.ptp(beyond[on:back]) < 0.005
        assert all(now <= before + 1e-6 for before, now in pairwise(beyond[back:]))
        assert beyond[-1] == 0.0


SEEDS = range(8)


@pytest.fixture(scope="module")
def flown() -> list[Flown]:
    return batch(SEEDS, 20.0).fly()


def test_flights_have_no_violation(flown: list[Flown]):
    assert [flight.violations for flight in flown] == [[] for _ in SEEDS]
    assert max(flight.worst_excursion for flight in flown) < 0.01
    assert sum(flight.transitions["VERIFYING -> MOVING"] for flight in flown) > 20
    assert sum(flight.transitions.get("VERIFYING -> HOVERING", 0) for flight in flown) > 5


@pytest.mark.thorough
def test_enabling_or_shrinking_the_cage_raises_no_alarm():
    module = compiled_kernel()
    some = missions(range(100, 400), 20.0)
    flights = Batch(some, lambda params: Compiled(params, module)).fly()
    assert {row for each in some for row in map(type, each.rows)} > {CageEvent, Resize}
    assert sum(each.stops.get("stopped, the goal is now outside the cage", 0) for each in flights)
    assert sum(each.stops.get("stopped, the path led out of the cage", 0) for each in flights) == 0


@pytest.mark.thorough
def test_a_flight_does_not_depend_on_the_rest_of_its_batch(flown: list[Flown]):
    assert batch([SEEDS[3]], 20.0).fly() == [flown[3]]


@pytest.mark.thorough
@pytest.mark.parametrize("faults", [False, True])
def test_sleeping_monitors_miss_nothing(faults: bool):
    some = missions(range(20, 24), 15.0, faults=faults)
    assert Batch(some, Plain).fly() == Sleepless(some, Plain).fly()


@pytest.mark.parametrize(
    ("seconds", "stops", "arrivals"),
    [(0.9, {}, 2), (1.5, {"stopped, the vehicle stood still": 1}, 1)],
)
def test_a_flight_survives_missing_poses_only_within_the_grace(seconds, stops, arrivals):
    rows = (
        GotoEvent(1.0, 4.0, 0.0, 1.0, False),
        Mute(1.6, seconds),
        GotoEvent(9.0, 4.0, 0.0, 1.0, False),
    )
    calm = replace(missions([0], 15.0)[0], dynamics=STILL, rows=rows)
    (flight,) = Batch([replace(calm, safety=SafetyParams())], Plain).fly()
    assert flight.violations == []
    assert flight.stops == stops
    assert len(flight.arrivals) == arrivals


def test_a_pause_of_the_setpoints_starts_the_time_at_a_standstill_anew():
    rows = (Stuck(0.5, 3.0), GotoEvent(1.0, 4.0, 0.0, 1.0, False), Deaf(1.2, 0.22))
    (flight,) = Batch([Mission(0, 4.0, SafetyParams(), STILL, rows)], Plain).fly()
    assert flight.violations == []
    assert flight.stops == {"stopped, the vehicle stood still": 1}


@pytest.mark.parametrize(("seconds", "stops", "arrivals"), [(0.9, {}, 1), (1.5, {"no pose": 1}, 0)])
def test_safety_without_poses_continues_only_within_the_grace(seconds, stops, arrivals):
    rows = (GotoEvent(1.0, 4.0, 0.0, 1.0, False), Deaf(1.6, seconds))
    calm = replace(missions([0], 9.0)[0], dynamics=STILL, rows=rows)
    (flight,) = Batch([replace(calm, safety=SafetyParams())], Plain).fly()
    assert (flight.violations, flight.stops) == ([], stops)
    assert len(flight.arrivals) == arrivals


@pytest.mark.thorough
def test_vehicles_of_a_flight_share_the_cage_and_are_summed_up():
    # Nothing keeps them apart: each flies as if it were alone.
    conditions = Conditions(8.0, wind=1.0, vehicles=3, given={"safety.separation.radius": 0.0})
    one, two = (
        workers.batch(Job(5, 2, conditions), Plain),
        workers.batch(Job(6, 1, conditions), Plain),
    )
    cages = {repr(mission.safety.virtual_cage) for mission in one.missions[:3]}
    assert len(cages) == 1
    assert len({repr(mission.dynamics.wind) for mission in one.missions[:3]}) == 1
    starts = [mission.dynamics.start for mission in one.missions[:3]]
    assert [(start.x, start.y) for start in starts] == [(0, 0), (2, 0), (0, 2)]
    flown = one.fly()
    assert flown[1:] == two.fly()
    assert flown[0].violations == []
    alone = Batch(one.missions[:3], Plain).fly()
    assert flown[0].worst_excursion == max(each.worst_excursion for each in alone)
    assert len(flown[0].arrivals) == sum(len(each.arrivals) for each in alone)
    assert flown[0].guards["HOVERING Goto always"] == sum(
        each.guards["HOVERING Goto always"] for each in alone
    )
    distance, at = flown[0].separation or (0.0, 0.0)
    assert 0 < distance <= 2.0
    assert 0 <= at <= 8.0
    assert alone[0].separation is None


@pytest.mark.thorough
def test_vehicles_of_a_flight_keep_apart():
    given = {"safety.virtual_cage.x": 2.0, "safety.virtual_cage.y": 2.0}
    flown = workers.batch(Job(0, 3, Conditions(15.0, vehicles=3, given=given)), Plain).fly()
    assert [flight.violations for flight in flown] == [[]] * 3
    assert sum(flight.refusals.get("separation", 0) for flight in flown) > 0


def unverified(rule: Rule) -> Rule:
    """Fly to every requested goal without verification."""
    return rule._replace(when=always) if (rule.on, rule.to) == (Check, State.MOVING) else rule


def not_verified_again(rule: Rule) -> Rule | None:
    """Do not verify the goal again when the cage comes on or shrinks."""
    return None if rule.on in {Toggle, Resized} and rule.when.__name__ == "barred" else rule


@pytest.mark.thorough
@pytest.mark.parametrize("change", [unverified, not_verified_again])
def test_a_broken_rule_is_detected(monkeypatch: pytest.MonkeyPatch, change):
    inject(monkeypatch, change)
    flights = batch(SEEDS, 20.0).fly()
    violations = {text for flight in flights for text in flight.violations}
    assert "MOVING to a goal outside with the cage on" in violations
    assert "more than 0.01 m beyond the cage" in violations


@pytest.mark.thorough
def test_live_flight_and_campaign_use_the_same_rules(
    monkeypatch: pytest.MonkeyPatch, flown: list[Flown]
):
    assert Rig().hovering().monitor.goto(OUTSIDE) != ""
    inject(monkeypatch, unverified)
    assert Rig().hovering().monitor.goto(OUTSIDE) == ""
    assert Rig().hovering().monitor.goto(Position(0.0, 0.0, 1.0)) == ""
    assert batch([SEEDS[0]], 20.0).fly() != [flown[0]]
