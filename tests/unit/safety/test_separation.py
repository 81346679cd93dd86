"""Separation: distances of spaces, and which ways come too near."""

import random
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from math import dist
from operator import itemgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from msgspec.structs import replace

from quadctl.schemas.messages import Position
from quadctl.schemas.params import SafetyParams
from quadctl.services.airspace.geometry import Piece, distance
from quadctl.services.airspace.separation import WIDER, How, Neighbour, Others, conflicts, why_near
from quadctl.services.safety.model import State
from quadctl.services.safety.monitor import Monitor
from quadctl.services.safety.traffic import Traffic, _Member
from tests.support import faulty_fleet
from tests.support.fleet_flights import FleetFlight, worst
from tests.support.monitored_vehicle import MonitoredVehicle
from tests.support.proofs import Proofs
from tests.support.worlds import POSE, RESTING

COORDINATES = st.floats(-5, 5) | st.integers(-3, 3).map(float)
POINTS = st.tuples(COORDINATES, COORDINATES, COORDINATES)
LINES = st.builds(Piece, POINTS, POINTS, st.just(False))


@st.composite
def boxes(draw: st.DrawFn) -> Piece:
    a, b = draw(POINTS), draw(POINTS)
    low, high = zip(*map(sorted, zip(a, b, strict=True)), strict=True)
    return Piece(low, high, is_box=True)


def samples(piece: Piece, steps: int) -> np.ndarray:
    """Return points of a piece, steps of them along each side."""
    start, way = np.array(piece.start), np.subtract(piece.end, piece.start)
    shares = np.linspace(0, 1, steps)
    if not piece.is_box:
        return start + shares[:, None] * way
    return start + np.array(list(product(shares, repeat=3))) * way


@example(
    Piece((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), False),
    Piece((0.0, 0.0, 0.0), (0.0, 1.0, 1.91e-06), False),
    1.0,
    1.0,
)
@pytest.mark.thorough
@given(LINES | boxes(), LINES | boxes(), st.floats(0.2, 2), st.floats(0.2, 2))
def test_the_distance_is_that_of_the_nearest_points(a: Piece, b: Piece, across: float, tall: float):
    found = distance((a,), (b,), across, tall)
    scale = np.array((across, across, tall))
    ours, theirs = (samples(piece, 9 if piece.is_box else 41) / scale for piece in (a, b))
    nearest = np.sqrt(((ours[:, None] - theirs[None]) ** 2).sum(axis=2).min())
    # Never more than that of any two points, and less by no more than half the samples' gaps.
    assert found <= nearest + 1e-6
    gaps = sum(
        dist(np.divide(p.start, scale), np.divide(p.end, scale)) / (8 if p.is_box else 40)
        for p in (a, b)
    )
    assert found >= nearest - gaps - 1e-9
    assert distance((b,), (a,), across, tall) == pytest.approx(found, abs=1e-6)


def neighbour(*space: Piece) -> Neighbour:
    return Neighbour("uav3", space, 0.6, 0.9, How.IS, clears=False)


def way(*points: tuple[float, float, float]) -> tuple[Piece, ...]:
    return tuple(map(Piece, points, points[1:]))


@pytest.mark.parametrize(
    ("points", "near"),
    [
        (((-2, 0, 1), (2, 0, 1)), True),
        (((-2, 0.63, 1), (2, 0.63, 1)), False),
        (((-2, 0.61, 1), (2, 0.61, 1)), True),  # a way keeps 2 cm farther away
        (((-2, 0, 1.93), (2, 0, 1.93)), False),
        (((-2, 0, 1.85), (2, 0, 1.85)), True),  # taller than wide
        # From too near, only away.
        (((0.3, 0, 1), (2, 0, 1)), False),
        (((0.3, 0, 1), (-2, 0, 1)), True),
        (((0.61, 0, 1), (0.61, 0, 3)), False),
        (((0.61, 0, 1), (0.5, 0, 3)), False),  # it rises as it comes nearer
        (((0.61, 0, 1), (0.5, 0, 1)), True),
    ],
)
def test_a_way_keeps_apart_from_a_vehicle(points, near: bool):
    there = neighbour(Piece((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)))
    found = conflicts(points[0], way(*points), Others(lambda _: [there]))
    assert bool(found) is near
    assert why_near(found) == ("separation: uav3 is too near the way" if near else "")


@pytest.mark.parametrize("how", [How.IS, How.FLIES])
@pytest.mark.parametrize("is_box", [True, False])
def test_beside_a_box_in_which_another_moves_a_vehicle_stays(is_box: bool, how: How):
    """It may be anywhere in the box: nobody knows whether a way brings both nearer."""
    space = Piece((0.0, -1.0, 1.0), (0.0, 1.0, 1.0), is_box)
    there = Neighbour("uav3", (space,), 0.6, 0.9, how, clears=True)
    along = way((0.4, 0.0, 1.0), (0.4, -1.0, 1.0))
    found = conflicts((0.4, 0.0, 1.0), along, Others(lambda _: [there]))
    assert bool(found) is (is_box and how is How.FLIES)


def test_a_vehicle_does_not_pass_where_another_that_stops_may_come_to_rest():
    fleet = flight((-0.45, 0.36, 0.11), (-1.29, -1.34, 0.42))
    assert fleet.goto(1, Position(0.56, 1.05, 1.16)) == ""
    while fleet.members[1].vehicle.position[0] < -0.41:
        fleet.fly(0.05)
    fleet.members[1].monitor.hold()
    fleet.fly(0.15)
    assert "uav1" in fleet.goto(0, Position(-0.61, -1.33, 0.04))
    assert fleet.land().nearest > 1


def flight(*starts: tuple[float, float, float]) -> FleetFlight:
    return FleetFlight(*(Position(*start) for start in starts))


def places(fleet: FleetFlight) -> list[Position]:
    return [member.monitor.pose.position for member in fleet.members]


def test_a_goal_past_another_vehicle_is_refused_with_its_name():
    fleet = flight((-1, 0, 1), (0, 0, 1))
    assert fleet.goto(0, Position(1, 0, 1)) == "separation: uav1 is too near the way"
    assert fleet.goto(0, Position(0, 1.4, 1)) == ""
    assert fleet.land().nearest > 1


def test_a_way_straight_down_beside_another_needs_a_vehicle_that_has_stopped_for_good():
    fleet = flight((0.92, 1.04, 1), (-0.17, 1.34, 1))
    below = Position(0.92, 1.04, 0)
    fleet.members[0].monitor.hold()
    assert fleet.goto(0, below) == "separation: uav1 is too near the way"
    fleet.fly(fleet.members[0].law.settling + 0.1)
    assert [fleet.goto(n, replace(p, z=0.0)) for n, p in enumerate(places(fleet))] == ["", ""]
    assert fleet.land().nearest > 1


def test_a_way_that_begins_near_the_floor_bends():
    flight = FleetFlight(Position(0.63, -0.05, 0.73), Position(0.06, 0.38, 1.6))
    assert flight.goto(0, Position(0.46, 0.96, 0.08)) == ""
    while flight.members[0].monitor.situation.state is not State.HOVERING:
        flight.period()
    past = Position(-0.32, -1.21, 1.52)
    assert flight.goto(0, past) == "separation: uav1 is too near the way"
    assert flight.land().goto(0, past) == "separation: uav1 is too near the way"
    assert flight.nearest >= 1


def test_a_way_is_reserved_until_it_has_been_flown():
    fleet = flight((-1.4, 0, 1), (1.4, 1.4, 1))
    assert fleet.goto(0, Position(1.4, 0, 1)) == ""
    crossing = Position(1.4, -1.4, 1)
    assert fleet.goto(1, crossing) == "separation: uav0 flies to a goal too near the way"
    assert fleet.goto(0, Position(-1.4, 0, 1), replace=True) == ""
    fleet.land()
    assert fleet.goto(1, crossing) == ""
    assert fleet.land().nearest > 1


def test_a_goal_waits_until_its_way_is_free():
    fleet = flight((-1.4, 0, 1), (0, 1.4, 1))
    assert fleet.goto(0, Position(1.4, 0, 1)) == ""
    reason = fleet.goto(1, Position(0, -1.4, 1), wait=True)
    assert reason == "waits: separation: uav0 flies too near the way"
    assert fleet.members[1].monitor.state().reason == reason
    fleet.land()
    assert fleet.nearest > 1
    assert abs(fleet.members[1].place.y + 1.4) < 0.01
    assert fleet.members[1].monitor.state().reason == ""


def test_a_vehicle_inside_the_space_of_one_that_stops_waits_until_it_rests():
    fleet = flight((0.95, -0.09, 2.23), (-0.03, 1.35, 1.14))
    assert fleet.goto(0, Position(-1.4, 1.42, 0.75)) == ""
    fleet.fly(0.3)
    assert fleet.goto(1, Position(-0.43, 0.16, 0.51), wait=True).startswith("waits")
    fleet.fly(0.3)
    fleet.members[0].monitor.hold()
    assert fleet.goto(1, Position(-0.43, 0.16, 0.51)) == "separation: uav0 flies too near the way"
    assert fleet.goto(1, Position(-0.43, 0.16, 0.51), wait=True).startswith("waits")
    assert fleet.land().nearest >= 1


def test_two_that_would_wait_for_each_other_are_told_so():
    fleet = flight((-1, 0, 1), (1, 0, 1))
    # Each stands on the other's goal: the first is refused, as nobody is about to leave.
    assert fleet.goto(0, Position(1, 0, 1), wait=True).startswith("separation: uav1 is")
    # A third flies between them; both wait for it, the second one for the first, too.
    fleet = flight((-1, 0, 1), (1, 0, 1), (0, 1.4, 1))
    assert fleet.goto(2, Position(0, -1.4, 1)) == ""
    fleet.goto(0, Position(1, 0.0, 1), wait=True)
    fleet.goto(1, Position(-1, 0.0, 1), wait=True)
    fleet.land()
    assert fleet.nearest > 1


def test_a_goal_that_waits_is_refused_once_nobody_will_leave():
    fleet = flight((-1.4, 0, 1), (0, 1.4, 1))
    fleet.goto(0, Position(1.4, 0, 1))
    assert fleet.goto(1, Position(0, -1.4, 1), wait=True).startswith("waits: separation: uav0")
    fleet.fly(0.6)
    fleet.members[0].monitor.hold()
    fleet.land()
    assert abs(fleet.members[0].place.x) < 0.6
    assert fleet.members[1].monitor.state().reason == "separation: uav0 is too near the way"


def test_hold_drops_a_goal_that_waits():
    fleet = flight((-1.4, 0, 1), (0, 1.4, 1))
    fleet.goto(0, Position(1.4, 0, 1))
    assert fleet.goto(1, Position(0, -1.4, 1), wait=True).startswith("waits")
    fleet.members[1].monitor.hold()
    fleet.land()
    assert fleet.members[1].place.y == pytest.approx(1.4, abs=0.01)


def waiting() -> FleetFlight:
    """Return a flight of one vehicle, for which a second one waits, for which a third one waits."""
    fleet = flight((-1.4, 0, 1), (0, 1.4, 1), (0, 4.0, 1))
    fleet.goto(0, Position(1.4, 0, 1))
    assert fleet.goto(1, Position(0, -1.4, 1), wait=True).startswith("waits: separation: uav0")
    assert fleet.goto(2, Position(0, 1.2, 1), wait=True).startswith("waits: separation: uav1")
    return fleet


def test_a_goal_that_waits_ends_with_the_poses_of_its_vehicle():
    fleet = waiting()
    blind = fleet.members[1].monitor
    blind.lose()
    blind.silent(0.5)
    assert blind.state().reason.startswith("waits"), "a pause within the grace"
    blind.silent(1.5)
    assert blind.state().reason == "the goal waits no more, no pose for 1 s"
    fleet.land()
    # It stays, also with poses; nobody waits behind it.
    assert fleet.members[1].place.y == pytest.approx(1.4, abs=0.01)
    assert fleet.members[2].monitor.state().reason.startswith("separation: uav1 ")


def test_a_goal_that_waits_ends_with_a_fault_of_its_vehicle():
    fleet = waiting()
    member = fleet.members[1]
    pose = member.monitor.pose
    x, y, z = (pose.position.x, pose.position.y, pose.position.z)
    member.monitor.see(replace(pose, stamp=pose.stamp + 0.001, position=Position(x + 3, y, z)))
    assert member.monitor.state().reason.startswith("stopped, the pose jumped by 3 m")
    fleet.land()
    assert member.place.y == pytest.approx(1.4, abs=0.01)


def test_a_goal_that_waits_ends_when_nobody_ahead_of_it_moves_on():
    fleet = waiting()
    # The clock of the second vehicle stands still, so that it can never fly.
    fleet.members.pop(1)
    fleet.fly(31.0)
    assert fleet.members[1].monitor.state().reason.startswith("waits")
    fleet.fly(5.0)
    reason = "the goal waits no more, no vehicle ahead of it has moved on for 30 s"
    assert fleet.members[1].monitor.state().reason == reason


def test_in_fleets_with_faults_no_goal_that_waits_hangs_and_all_land_or_are_told_why():
    assert faulty_fleet.worst(range(10)) == []


@pytest.mark.prove
@pytest.mark.timeout(7200)
def test_10_000_fleets_with_faults_hang_nowhere(proofs: Proofs):
    with ProcessPoolExecutor() as pool:
        shares = pool.map(faulty_fleet.worst, [range(n, n + 500) for n in range(10, 10_010, 500)])
        wrong = [line for share in shares for line in share]
    proofs.add("10 000 fleets with goals that wait, and faults", f"{len(wrong)} hang or hover", "0")
    assert wrong == []


def test_vehicles_that_start_too_near_may_only_leave_each_other():
    fleet = flight((0, 0, 1), (0.3, 0, 1))
    assert fleet.goto(0, Position(1, 0, 1)).startswith("separation: uav1")
    assert fleet.goto(0, Position(-1, 0, 1)) == ""
    fleet.land()
    assert fleet.nearest == pytest.approx(0.5, abs=0.01)


def test_a_vehicle_pushed_towards_another_stops_both():
    fleet = flight((-1.4, 0, 1), (1.4, 1.2, 1))
    assert fleet.goto(0, Position(1.4, 0, 1)) == ""
    fleet.fly(0.3)
    # The second one leaves its place by no goal of its own: a gust, or a fault.
    fleet.members[1].vehicle.goto(0.6, 0.0, 1.0)
    fleet.fly(5)
    reason = fleet.members[0].monitor.state().reason
    assert reason == "stopped, separation: uav1 came too near"


def test_a_reset_onto_the_way_of_another_stops_that_one():
    fleet = flight((-1.4, 0, 1), (1.4, 1.2, 1))
    assert fleet.goto(0, Position(1.4, 0, 1)) == ""
    fleet.fly(0.3)
    ahead = replace(POSE, boot="later", position=Position(0.5, 0, 1), velocity=RESTING)
    fleet.members[1].monitor.see(ahead)
    reason = fleet.members[0].monitor.state().reason
    assert reason == "stopped, separation: uav1 is too near the way"


def launched(traffic: Traffic) -> MonitoredVehicle:
    """Vehicle on the floor that is to take off, among those that its process begins with."""
    made = MonitoredVehicle(SafetyParams(takeoff=1.0), Position(0.0, 0.0, 0.0), "uav0", traffic)
    traffic.expect("uav0")
    traffic.expect("uav1")
    made.see()
    return made


def test_at_a_launch_nobody_takes_off_before_all_are_attended_to():
    traffic = Traffic()
    monitor = launched(traffic).monitor
    traffic.attend("uav0")
    assert (monitor.takes_off, monitor.situation.flies) == (True, False)
    assert not traffic.may_take_off(1.0)
    traffic.attend("uav1")
    assert traffic.may_take_off(1.0)
    monitor.take_off()
    assert (monitor.takes_off, monitor.situation.flies) == (False, True)


def test_at_a_launch_take_offs_follow_each_other():
    traffic = Traffic()
    counts = [sum(traffic.may_take_off(now) for _ in range(1000)) for now in (9.0, 9.0, 9.15, 19.0)]
    assert counts == [20, 0, 10, 20]


@pytest.mark.parametrize("request_", [Monitor.hold, lambda m: m.goto(Position(1.0, 0.0, 1.0))])
def test_a_request_during_the_launch_replaces_the_take_off(request_: Callable[[Monitor], object]):
    monitor = launched(Traffic()).monitor
    request_(monitor)
    assert not monitor.takes_off


def test_random_flights_in_a_small_box_keep_apart():
    nearest, verdicts, seed = worst(range(5))
    assert nearest >= 1, f"seed {seed}: {nearest}"
    assert min(verdicts.values()) > 1


FLIGHTS, PROCESSES = 10_000, 2


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(7200)
def test_10_000_flights_of_ten_in_a_small_box_keep_apart(proofs: Proofs):
    with ProcessPoolExecutor(PROCESSES) as pool:
        parts = list(pool.map(worst, (range(n, FLIGHTS, PROCESSES) for n in range(PROCESSES))))
    nearest, _, seed = min(parts, key=itemgetter(0))
    verdicts = sum((Counter(of_part) for _, of_part, _ in parts), Counter[str]())
    goals = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
    proofs.add(
        f"least distance of two vehicles, {FLIGHTS} random flights of 10 in a box of 3 x 3 x 2.5 m",
        f"{nearest:.3f} of what they keep; goals: {goals}; none waits for ever", "at least 1",
    )  # fmt: skip
    assert nearest >= 1, f"seed {seed}"


def test_what_is_far_from_a_way_is_not_computed_and_would_not_matter(
    monkeypatch: pytest.MonkeyPatch,
):
    real, clear = Traffic._near, _Member.is_clear
    skipped, kept = 0, 0

    def near(traffic: Traffic, name: str, *of: Any) -> list[Neighbour]:
        nonlocal skipped, kept
        found = real(traffic, name, *of)
        monkeypatch.setattr(_Member, "is_clear", lambda *_: False)
        everybody = real(traffic, name, *of)
        monkeypatch.setattr(_Member, "is_clear", clear)
        assert [one for one in everybody if one in found] == found
        for one in everybody:
            if one not in found:
                assert distance(of[-1], one.space, one.across + WIDER, one.tall + WIDER) >= 1
        skipped, kept = skipped + len(everybody) - len(found), kept + len(found)
        return found

    monkeypatch.setattr(Traffic, "_near", near)
    draws = random.Random(3)

    def place() -> Position:
        return Position(draws.uniform(-4, 4), draws.uniform(-4, 4), draws.choice([0.0, 0.3, 1, 2]))

    flight = FleetFlight(*(Position(2.0 * n - 5, 0.0, 1.0) for n in range(6)), size=6.0)
    for _ in range(150):
        flight.goto(draws.randrange(6), place(), replace=True, wait=draws.random() < 0.5)
        if draws.random() < 0.1:
            flight.members[draws.randrange(6)].monitor.hold()
        flight.fly(draws.choice([0.05, 0.4, 2.0]))
    assert skipped > 300
    assert kept > 100
    assert flight.nearest >= 1
