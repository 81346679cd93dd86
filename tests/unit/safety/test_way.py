"""Ways among zones: around them in legs, in flight and from rest, and the depth of random flights."""

import itertools
import random
from concurrent.futures import ProcessPoolExecutor

import pytest
from msgspec import structs

from quadctl.schemas.messages import Position
from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.vehicle import ControlParams
from quadctl.schemas.zones import CircleParams, ZoneParams
from quadctl.services.airspace.geometry import Point
from quadctl.services.airspace.zones import Region
from quadctl.services.safety import motion
from quadctl.services.safety.model import State
from tests.support.proofs import Proofs
from tests.support.zone_flights import ZoneFlight, drawn_flight, search, worst

TOWER = ZoneParams("tower", polygon=((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)))
LOW = ZoneParams("low", polygon=TOWER.polygon, ceiling=1.2)
ROUND = ZoneParams("round", circle=CircleParams(1.5, 0.0, 1.0))
# fmt: off
U = ZoneParams("u", polygon=((1, -2), (4, -2), (4, -1.5), (1.5, -1.5), (1.5, 1.5), (4, 1.5), (4, 2), (1, 2)))
# fmt: on
BEHIND = Position(3.0, 0.0, 1.0)


def legs_of(flight: ZoneFlight) -> list[Point]:
    s = flight.monitor.situation
    return [s.goal, *s.corners]


@pytest.mark.parametrize("zone", [TOWER, LOW, ROUND, U], ids=lambda zone: zone.name)
def test_a_zone_in_the_way_is_flown_around_as_one_request(zone: ZoneParams):
    flight = ZoneFlight(zone)
    assert flight.goto(BEHIND) == ""
    points = [(0.0, 0.0, 1.0), *legs_of(flight)]
    state = flight.monitor.state()
    assert (state.leg, state.legs, state.goal) == (1, len(points) - 1, BEHIND)
    assert not any(Region([zone]).why_crosses(a, b) for a, b in itertools.pairwise(points))
    seen = {1}
    while not flight.is_done:
        seen.add(flight.fly(0.05).monitor.situation.leg)
    assert seen == {*range(1, state.legs + 1), 0}
    assert (flight.monitor.state().legs, flight.deepest) == (0, 0.0)
    assert flight.place.x == pytest.approx(3.0, abs=0.01)


def test_a_low_zone_is_flown_over_where_that_is_shorter():
    flight = ZoneFlight(
        ZoneParams("wall", polygon=((1, -5), (1.5, -5), (1.5, 5), (1, 5)), ceiling=1.1)
    )
    assert flight.goto(BEHIND) == ""
    assert all(1.1 < z < 1.2 for _, _, z in legs_of(flight)[:-1])
    assert flight.land().deepest == 0.0


def test_a_way_around_from_the_floor_begins_with_a_climb():
    flight = ZoneFlight(ROUND, start=Position(0.0, 0.0, 0.0))
    bent = "the way crosses the zone round: from the floor a way bends; rise first"
    assert flight.goto(BEHIND, direct=True) == bent
    assert flight.goto(BEHIND) == ""
    assert legs_of(flight)[0][:2] == (0.0, 0.0)
    assert flight.land().deepest == 0.0
    assert flight.place.x == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("height", [0.1, 0.117, 0.125, 0.129])
def test_a_leg_of_centimetres_ends_before_the_next_one_begins(height: float):
    """On so short a leg the vehicle is never faster than one at rest."""
    body = DynamicsParams(control=ControlParams(max_acceleration=1.1))
    flight = ZoneFlight(ROUND, start=Position(0.0, 0.0, height), body=body)
    assert flight.goto(BEHIND) == ""
    assert flight.monitor.situation.goal[2] == pytest.approx(0.13)
    while flight.monitor.situation.leg == 1:
        flight.fly(0.05)
    assert flight.monitor.situation.leg == 2
    assert flight.vehicle.setpoint[2] == pytest.approx(0.13, abs=0.001)
    assert flight.vehicle.velocity[2] == pytest.approx(0.0, abs=0.002)


def test_a_vehicle_that_stands_in_a_zone_rises_out_of_it():
    floor = Position(0.0, 0.0, 0.0)
    mat = ZoneParams("mat", polygon=((-2, -2), (2, -2), (2, 2), (-2, 2)), ceiling=0.5)
    above = structs.replace(mat, name="lab", kind="inclusion", floor=0.5, ceiling=10.0)
    for zone in (mat, above):
        flight = ZoneFlight(zone, start=floor)
        assert flight.goto(Position(0.0, 0.0, 1.0)) == ""
        assert flight.fly(3.0).place.z == pytest.approx(1.0, abs=0.01)
    flight = ZoneFlight(mat, start=floor)
    assert flight.goto(Position(0.0, 0.0, 0.2)) == "inside the zone mat"
    assert flight.goto(Position(1.0, 0.0, 1.0)).endswith("from the floor a way bends; rise first")


@pytest.mark.parametrize("periods", range(10))
def test_a_leg_that_begins_near_the_floor_bends(periods: int):
    beside = ZoneParams("beside", circle=CircleParams(0.35, 0.6, 0.2), floor=0.9)
    flight = ZoneFlight(beside, start=Position(0.63, -0.05, 0.73))
    assert flight.goto(Position(0.46, 0.96, 0.08)) == ""
    while flight.monitor.situation.state is not State.HOVERING:
        flight.fly(0.05)
    flight.fly(0.05 * periods)
    assert flight.goto(Position(-0.32, -1.21, 1.52)) == ""
    assert flight.land().deepest == 0.0


def test_a_refused_goal_leaves_a_landing_beside_a_zone_alone():
    diamond = ZoneParams("diamond", polygon=((0, 0), (1.5, -1.5), (3, 0), (1.5, 1.5)))
    flight = ZoneFlight(diamond, start=Position(-0.6, 0.5, 1.0))
    assert flight.goto(Position(0.9, -1.0, 0.0)) == ""
    while flight.monitor.situation.state is not State.HOVERING:
        flight.fly(0.05)
    while flight.place.z > 0:
        assert flight.goto(Position(1.5, 0.0, 1.0)) == "inside the zone diamond"
        flight.fly(0.05)
    assert flight.monitor.situation.goal == (0.9, -1.0, 0.0)


def test_a_direct_way_is_refused_and_changes_nothing():
    flight = ZoneFlight(TOWER)
    before = flight.monitor.setpoint()
    assert flight.goto(BEHIND, direct=True) == "the way crosses the zone tower"
    assert flight.monitor.setpoint().position == before.position
    assert flight.goto(Position(1.5, 0.0, 1.0)) == "inside the zone tower"


def test_where_no_way_leads_the_reason_says_so():
    ring = [ZoneParams(f"wall{n}", polygon=corners) for n, corners in enumerate((
        ((-3, -3), (3, -3), (3, -2), (-3, -2)), ((-3, 2), (3, 2), (3, 3), (-3, 3)),
        ((-3, -2), (-2, -2), (-2, 2), (-3, 2)), ((2, -2), (3, -2), (3, 2), (2, 2)),
    ))]  # fmt: skip
    reason = ZoneFlight(*ring).goto(Position(5.0, 0.0, 1.0))
    assert reason == "the way crosses the zone wall3; no way around it was found"


def test_a_gap_narrower_than_the_clearance_is_still_a_way():
    walls = (
        ZoneParams("left", polygon=((1, 0.01), (1.2, 0.01), (1.2, 6), (1, 6))),
        ZoneParams("right", polygon=((1, -6), (1.2, -6), (1.2, -0.01), (1, -0.01))),
    )
    flight = ZoneFlight(*walls, start=Position(0.0, 2.0, 1.0))
    assert flight.goto(Position(3.0, 2.0, 1.0)) == ""
    assert flight.land().deepest == 0.0


def test_inclusion_zones_lead_the_way_through_what_they_share():
    hall = ZoneParams("hall", "inclusion", polygon=((-1, -1), (1, -1), (1, 4), (-1, 4)))
    wing = ZoneParams("wing", "inclusion", polygon=((0, 3), (5, 3), (5, 5), (0, 5)))
    flight = ZoneFlight(hall, wing)
    assert flight.goto(Position(4.0, 4.0, 1.0)) == ""
    assert len(legs_of(flight)) > 1
    assert flight.land().deepest == 0.0
    assert flight.goto(Position(-3.0, 0.0, 1.0)) == "outside the zones hall, wing"


def test_a_vehicle_that_arrives_turns_at_its_goal_unless_a_curve_is_clear():
    flight = ZoneFlight(TOWER, start=Position(0.0, -3.0, 1.0))
    assert flight.goto(Position(0.0, 3.0, 1.0)) == ""
    while flight.monitor.situation.state is State.MOVING:
        flight.fly(0.05)
    assert flight.goto(Position(-2.0, 0.0, 1.0)) == ""  # a curve, clear of the tower
    assert flight.monitor.situation.legs == 0
    flight.land()
    assert flight.goto(Position(0.0, 3.0, 1.0)) == ""
    while flight.monitor.situation.state is State.MOVING:
        flight.fly(0.05)
    assert flight.goto(Position(4.0, 0.0, 1.0)) == ""  # past the tower, so from rest
    assert legs_of(flight)[0] == (0.0, 3.0, 1.0)
    assert flight.land().deepest == 0.0


def test_in_flight_a_change_of_course_near_a_zone_is_refused():
    flight = ZoneFlight(TOWER, start=Position(0.0, -3.0, 1.0))
    assert flight.goto(Position(0.0, 3.0, 1.0)) == ""
    flight.fly(1.0)
    reason = flight.goto(Position(4.0, 3.0, 1.0), replace=True)
    assert reason.startswith("the way crosses the zone tower: in flight a way bends")
    assert flight.monitor.situation.state is State.MOVING
    flight.land()
    assert flight.place.y == pytest.approx(3.0, abs=0.01)


def test_a_zone_added_in_flight_holds_at_once():
    flight = ZoneFlight()
    assert flight.goto(Position(5.0, 0.0, 1.0)) == ""
    flight.fly(0.5).set_zones(ZoneParams("late", polygon=((3, -1), (4, -1), (4, 1), (3, 1))))
    assert flight.monitor.state().reason == "stopped, the way crosses the zone late"
    assert flight.land().fly(0.5).place.x < 3.0
    flight.set_zones(ZoneParams("here", circle=CircleParams(flight.place.x, 0.0, 0.5)))
    assert "late" in flight.monitor.state().reason  # at rest after a stop there is no goal to bar
    # It may leave the zone, and not come back.
    assert flight.goto(Position(-2.0, 0.0, 1.0)) == ""
    flight.land()
    assert flight.goto(Position(5.0, 0.0, 1.0), direct=True) == "the way crosses the zone here"


def test_a_cage_that_is_off_turns_zones_off():
    flight = ZoneFlight(TOWER)
    flight.monitor.toggle(cage_on=False)
    assert flight.monitor.state().nearest.name == ""
    assert flight.goto(BEHIND) == ""
    flight.fly(0.3).monitor.toggle(cage_on=True)
    assert flight.monitor.state().reason == "stopped, the way crosses the zone tower"


def test_a_pause_keeps_the_legs():
    flight = ZoneFlight(TOWER)
    assert flight.goto(BEHIND) == ""
    flight.fly(0.5).monitor.lose()
    assert flight.monitor.state().legs == 3
    assert flight.fly(0.05).monitor.situation.state is State.MOVING
    assert flight.land().deepest == 0.0
    assert flight.place.x == pytest.approx(3.0, abs=0.01)


def test_the_nearest_wall_is_published_with_a_warning():
    flight = ZoneFlight(TOWER, start=Position(0.75, 0.0, 1.0))
    wall = flight.monitor.state().nearest
    assert (wall.name, wall.near) == ("tower", True)
    assert wall.distance == pytest.approx(0.25, abs=1e-3)
    far = ZoneFlight(TOWER).monitor.state().nearest
    assert (far.name, far.near) == ("tower", False)


def test_random_flights_never_enter_a_zone():
    deepest, verdicts, at = worst(range(25))
    assert deepest <= 0.01, f"seed {at}"
    assert min(verdicts.values()) > 5


@pytest.mark.thorough
def test_flights_whose_ways_are_not_checked_do_enter(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motion, "why_barred", lambda *_: "")
    assert worst(range(10))[0] > 0.1


def test_a_guard_stops_a_vehicle_that_leaves_its_way():
    flight = ZoneFlight(TOWER).fly(1.0)
    flight.vehicle.goto(1.5, 0.0, 1.0)  # on its own
    flight.fly(1.5)
    assert "into a zone by" in flight.monitor.state().reason
    assert flight.monitor.setpoint().brake


class _Guarded(ZoneFlight):
    """Flight that counts the stops of the guard."""

    stops = 0

    def _period(self) -> None:
        before = self.monitor.situation.reason
        super()._period()
        reason = self.monitor.situation.reason
        self.stops += reason != before and "path led" in reason


@pytest.mark.parametrize("seed", [35, 142, 235, 279, 307, 365])
def test_no_guard_stops_a_vehicle_that_passes_a_zone_on_its_way(seed: int):
    flight = drawn_flight(random.Random(seed), _Guarded)
    assert isinstance(flight, _Guarded)
    assert flight.stops == 0


FLIGHTS = 10_000


@pytest.mark.prove
@pytest.mark.timeout(5400)
def test_10_000_random_flights_among_random_zones_enter_none(proofs: Proofs):
    deepest, verdicts, at = worst(range(FLIGHTS))
    goals = f"{verdicts[True]} goals taken, {verdicts[False]} refused"
    proofs.add(
        f"greatest depth in a zone, {FLIGHTS} random flights among random zones",
        f"{1000 * deepest:.1f} mm; {goals}", "at most 10 mm",
    )  # fmt: skip
    assert deepest <= 0.01, f"seed {at}"


EVALUATIONS, ISLANDS = 100_000, 4


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(10_800)
def test_a_search_of_100_000_flights_enters_no_zone(proofs: Proofs):
    with ProcessPoolExecutor(ISLANDS) as pool:
        found = list(pool.map(search, [EVALUATIONS // ISLANDS] * ISLANDS, range(ISLANDS)))
    deepest, nearest = max(one[0] for one in found), min(one[1] for one in found)
    proofs.add(
        f"greatest depth in a zone, a search of {EVALUATIONS} flights for the deepest",
        f"{1000 * deepest:.1f} mm; the nearest passed {1000 * nearest:.1f} mm beside one",
        "at most 10 mm",
    )  # fmt: skip
    assert deepest <= 0.01
