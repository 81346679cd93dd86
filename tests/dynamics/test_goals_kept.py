"""Goals that a campaign found to be passed, by way of a replaced goal, a landing or a short climb."""

import pytest

from quadctl.schemas.params import DynamicsParams, StartParams
from quadctl.services.dynamics.vehicle import Vehicle

Point = tuple[float, float, float]


def standing_at(x: float, y: float, z: float) -> Vehicle:
    return Vehicle(DynamicsParams(start=StartParams(x, y, z)))


def extremes(vehicle: Vehicle, seconds: float) -> tuple[Point, Point]:
    """The least and the greatest x, y and z on the way."""
    places = []
    for _ in range(round(100 * seconds)):
        vehicle.advance(10)
        places.append(vehicle.position)
    xs, ys, zs = zip(*places, strict=True)
    return (min(xs), min(ys), min(zs)), (max(xs), max(ys), max(zs))


def test_an_axis_that_brakes_keeps_the_jerk_to_end_its_braking():
    vehicle = standing_at(-4.0, 1.45, 0.84)
    vehicle.goto(6.82, 2.10, 0.98)
    while vehicle.position[0] < 4.8:
        vehicle.advance(10)
    # Most of the limits are for y now; what x is left with must still stop it before its goal.
    vehicle.goto(7.13, -2.13, 0.0)
    vehicle.advance(100)
    vehicle.brake()
    assert 6.0 < vehicle.goal[0] <= 7.13
    _, most = extremes(vehicle, 4.0)
    assert most[0] < vehicle.goal[0] + 0.001


def test_a_hop_that_is_asked_for_in_motion_does_not_lead_back():
    vehicle = standing_at(0.0, 0.0, 0.01)
    vehicle.goto(6.0, 0.0, 0.35)
    while vehicle.position[0] < 0.6:
        vehicle.advance(10)
    assert vehicle.position[2] < 0.05
    assert vehicle.velocity[0] > 2
    vehicle.goto(6.0, 1.0, 0.06)
    start, furthest = vehicle.position[0], 0.0
    for _ in range(400):
        vehicle.advance(10)
        furthest = max(furthest, vehicle.position[0])
        assert vehicle.position[0] > furthest - 0.001
    assert start < furthest < 6.001


@pytest.mark.parametrize("corner", [(2.0, 1.0, 0.0), (-0.3, 0.45, 0.0), (0.5, 0.0, 0.05)])
def test_a_landing_from_afar_ends_where_it_was_to(corner: Point):
    vehicle = standing_at(-3.6, -4.3, 0.5)
    vehicle.goto(*corner)
    _, most = extremes(vehicle, 6.0)
    assert vehicle.position == pytest.approx(corner, abs=0.002)
    assert most[0] < corner[0] + 0.004
    assert most[1] < corner[1] + 0.004


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((-0.135, 0.167, 0.161), (-0.319, 0.304, 0.573)),
        ((-0.495, 0.183, 0.034), (-0.622, 0.370, 0.282)),
        ((0.0, 0.0, 1.0), (0.15, 0.15, 1.3)),
    ],
)
def test_a_short_climb_aslant_does_not_pass_its_goal(start: Point, goal: Point):
    vehicle = standing_at(*start)
    vehicle.goto(*goal)
    _, most = extremes(vehicle, 3.0)
    assert most[2] < goal[2] + 0.004


def test_a_flat_way_far_off_does_not_scrape_the_floor():
    vehicle = standing_at(0.0, 0.0, 0.0)
    vehicle.goto(40.0, 0.0, 0.2)
    vehicle.advance(4000)
    lag = vehicle.setpoint[0] - vehicle.position[0]
    assert vehicle.position[2] > 0.05
    assert abs(lag) < 0.05
