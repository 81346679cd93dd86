"""The whole vehicle: flights to goals, landings and braking, without overshoot."""

from math import acos, cos, dist, hypot, sin, sqrt
from random import Random

import pytest
from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from quadctl.schemas.vehicle import ControlParams, VehicleParams
from quadctl.services.airspace import airworthiness
from quadctl.services.airspace.stopping import AT_REST, PATIENCE
from quadctl.services.dynamics import flight_modes
from quadctl.services.dynamics.rigidbody import body_constants, step
from quadctl.services.dynamics.vehicle import Vehicle

DIAGONAL = 3 / sqrt(3)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Vehicle:
    return Vehicle(DynamicsParams(start=StartParams(x, y, z)))


def tilt(vehicle: Vehicle) -> float:
    _, x, y, _ = vehicle.orientation
    return acos(1 - 2 * (x * x + y * y))


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.0, 0.0, 1.0), (3.0, 0.0, 1.0)),
        ((0.0, 0.0, 1.0), (0.0, -3.0, 1.0)),
        ((0.0, 0.0, 1.0), (DIAGONAL, -DIAGONAL, 1.0 + DIAGONAL)),
        ((0.0, 0.0, 4.0), (DIAGONAL, DIAGONAL, 4.0 - DIAGONAL)),
        ((0.0, 0.0, 1.0), (0.0, 0.0, 4.0)),
        ((0.0, 0.0, 4.0), (0.0, 0.0, 1.0)),
    ],
    ids=["ahead", "right", "up and aside", "down and aside", "up", "down"],
)
def test_a_three_metre_flight_is_fast_and_does_not_overshoot(start, goal):
    vehicle = at(*start)
    vehicle.goto(*goal)
    distance = []
    for _ in range(4000):
        vehicle.advance(1)
        distance.append(dist(vehicle.position, goal))
        assert dist(vehicle.position, start) <= 3.0 + 1e-3
    assert distance[1600] < 0.5
    assert distance[1900] < 0.2
    hover = distance[3000:]
    assert sqrt(sum(d * d for d in hover) / len(hover)) < 1e-4


def test_the_vehicle_stays_close_to_its_setpoint_at_full_speed():
    vehicle = at(z=10.0)
    vehicle.goto(40.0, 20.0, 10.0)
    fastest = 0.0
    for _ in range(3000):
        vehicle.advance(4)
        assert dist(vehicle.position, vehicle.setpoint) < 0.01
        fastest = max(fastest, hypot(*vehicle.velocity))
    assert fastest == pytest.approx(5.0, abs=0.02)


def test_the_vehicle_idles_on_the_floor_until_a_goal_above_it():
    vehicle = at()
    vehicle.goto(0.01, 0.0, 0.0)
    vehicle.advance(500)
    assert (vehicle.position, vehicle.motors, vehicle.standing) == ((0, 0, 0), (0, 0, 0, 0), True)


def test_the_takeoff_does_not_overshoot_or_slide():
    vehicle = at()
    vehicle.goto(0.0, 0.0, 1.0)
    for _ in range(4000):
        vehicle.advance(1)
        assert vehicle.position[2] <= 1.0 + 1e-3
        assert hypot(*vehicle.position[:2]) < 1e-9
        assert dist(vehicle.position, vehicle.setpoint) < 0.02
    assert vehicle.position[2] == pytest.approx(1.0, abs=1e-6)


def test_the_vehicle_lands_stops_its_motors_and_takes_off_again():
    vehicle = at(z=2.0)
    vehicle.goto(2.0, 0.0, 0.0)
    vehicle.advance(6000)
    assert vehicle.standing
    assert vehicle.position == pytest.approx((2.0, 0.0, 0.0), abs=0.005)
    assert max(vehicle.motors) < 1e-3
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(4000)
    assert vehicle.position == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)


def test_a_vehicle_that_dropped_tilted_stands_level_and_takes_off_again():
    strong = WindParams(mean=MeanWindParams(x=10.0))
    vehicle = Vehicle(DynamicsParams(start=StartParams(0.0, 0.0, 1.0), wind=strong))
    vehicle.goto(0.0, 0.0, 0.0)
    while vehicle.position[2] > 0.05:
        vehicle.advance(1)
    assert tilt(vehicle) > 0.6
    vehicle.stand()
    vehicle.advance(500)
    assert tilt(vehicle) == 0.0
    vehicle.configure(DynamicsParams())
    vehicle.stand()
    x, y, z = vehicle.position
    assert z == 0.0
    vehicle.goto(x, y, 1.0)
    vehicle.advance(3000)
    assert vehicle.position == pytest.approx((x, y, 1.0), abs=1e-3)


def test_a_goal_below_the_floor_is_a_soft_landing():
    vehicle = at(z=2.0)
    vehicle.goto(0.0, 0.0, -5.0)
    impact = 0.0
    for _ in range(4000):
        before = vehicle.velocity[2]
        vehicle.advance(1)
        if vehicle.position[2] == 0.0:
            impact = max(impact, -before)
    assert vehicle.standing
    assert impact < 0.1


def test_a_vehicle_started_in_the_air_hovers():
    vehicle = at(1.0, 2.0, 3.0)
    vehicle.advance(60_000)
    assert vehicle.time == 60.0
    assert vehicle.position == pytest.approx((1.0, 2.0, 3.0), abs=1e-9)


@pytest.mark.parametrize(
    "goal", [(100.0, 0.0, 20.0), (60.0, -60.0, 40.0)], ids=["level", "diagonal"]
)
def test_braking_at_full_speed_stops_where_predicted(goal):
    start = (0.0, 0.0, 20.0)
    vehicle = at(*start)
    vehicle.goto(*goal)
    vehicle.advance(2500)
    vehicle.brake()
    stops = vehicle.goal
    way = dist(stops, start)
    for _ in range(4000):
        vehicle.advance(1)
        assert dist(vehicle.position, start) <= way + 1e-3
        assert (
            sum(v * (g - s) for v, g, s in zip(vehicle.velocity, goal, start, strict=True)) > -0.05
        )
    assert dist(vehicle.position, stops) < 1e-3


def test_repeated_commands_change_nothing():
    once, often = at(z=10.0), at(z=10.0)
    for k in range(300):
        if k == 0:
            once.goto(9.0, -4.0, 12.0)
        if k == 120:
            once.brake()
        if k == 200:
            once.goto(9.0, -4.0, 12.0)
        if 120 <= k < 200:
            often.brake()
        else:
            often.goto(9.0, -4.0, 12.0)
        once.advance(10)
        often.advance(10)
    assert once.position == often.position
    assert once.goal == (9.0, -4.0, 12.0)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_goals_keep_the_vehicle_upright_and_within_limits(seed):
    random, vehicle = Random(seed), at(z=20.0)
    for _ in range(100):
        vehicle.goto(random.uniform(-10, 10), random.uniform(-10, 10), random.uniform(10, 30))
        for _ in range(30):
            vehicle.advance(10)
            # The limit is the command's; the body follows it with a little overshoot.
            assert tilt(vehicle) < 0.7 * 1.02
            assert hypot(*vehicle.velocity) < 5.5
            assert dist(vehicle.position, vehicle.setpoint) < 0.5
    vehicle.goto(0.0, 0.0, 20.0)
    vehicle.advance(10_000)
    assert dist(vehicle.position, (0.0, 0.0, 20.0)) < 1e-3


@pytest.mark.thorough
def test_the_vehicle_follows_a_goal_on_a_circle():
    vehicle = at(5.0, 0.0, 10.0)
    for k in range(100):
        vehicle.goto(5.0 * cos(0.24 * k), 5.0 * sin(0.24 * k), 10.0)
        for _ in range(75):
            vehicle.advance(4)
            assert dist(vehicle.position, vehicle.setpoint) < 0.05
            # The limit is the command's; the body follows it with a little overshoot.
            assert tilt(vehicle) < 0.7 * 1.02


def test_the_step_size_does_not_change_a_bit():
    def state(sizes: list[int]) -> tuple[float, ...]:
        vehicle = at()
        vehicle.goto(2.0, 1.0, 1.5)
        for size in sizes:
            vehicle.advance(size)
        return (
            vehicle.position
            + vehicle.velocity
            + vehicle.orientation
            + vehicle.body_rates
            + vehicle.motors
        )

    assert state([3000]) == state([1] * 3000) == state([7] * 428 + [4]) == state([10] * 300)


def test_quarter_steps_end_in_the_same_place():
    """The integration error of a 5 s flight falls with the fourth power of the step."""
    coarse, fine = at(z=1.0), at(z=1.0)
    body = body_constants(VehicleParams(), 0.00025)

    def four_steps(state, command, wind, _):
        for _ in range(4):
            state = step(state, command, wind, body)
        return state

    coarse.goto(2.0, -1.0, 2.0)
    coarse.advance(5000)
    fine.goto(2.0, -1.0, 2.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight_modes, "step", four_steps)
        fine.advance(5000)
    assert dist(coarse.position, fine.position) < 1e-8


def everything(vehicle: Vehicle) -> tuple[object, ...]:
    return vehicle.position, vehicle.velocity, vehicle.setpoint, vehicle.goal


def test_new_body_gains_and_limits_wait_for_the_next_standstill():
    vehicle, other = at(z=10.0), at(z=10.0)
    for each in (vehicle, other):
        each.goto(20.0, 0.0, 10.0)
        each.advance(1000)
    vehicle.configure(
        DynamicsParams(
            vehicle=VehicleParams(mass=1.2),
            control=ControlParams(max_speed=1.0, max_acceleration=0.5, max_jerk=2.0),
        )
    )
    for _ in range(600):
        assert everything(vehicle) == everything(other)
        vehicle.advance(10)
        other.advance(10)
    assert vehicle.in_force == DynamicsParams(start=vehicle.in_force.start)
    vehicle.advance(5000)
    assert vehicle.in_force.vehicle.mass == 1.2
    assert vehicle.position == pytest.approx((20.0, 0.0, 10.0), abs=1e-6)
    vehicle.goto(25.0, 0.0, 10.0)
    fastest = 0.0
    for _ in range(800):
        vehicle.advance(10)
        fastest = max(fastest, vehicle.velocity[0])
    assert fastest == pytest.approx(1.0, abs=0.01)


def test_at_a_standstill_new_parameters_apply_without_a_movement():
    for mass in (0.3, 2.5):
        vehicle = at(z=10.0)
        vehicle.configure(DynamicsParams(vehicle=VehicleParams(mass=mass)))
        assert vehicle.in_force.vehicle.mass == mass
        vehicle.advance(1000)
        assert dist(vehicle.position, (0.0, 0.0, 10.0)) < 1e-6


@pytest.mark.parametrize("body", airworthiness.BODIES, ids=lambda body: body.name)
def test_every_body_that_is_accepted_moves_before_safety_takes_it_for_standing_still(body):
    """Its motors spin up first: with slow ones that takes most of the time."""
    slow = replace(body.control, attitude_gain=body.control.attitude_gain / 1.3)
    for share in range(20, 41):
        lag = share / 20 * body.vehicle.motor_lag
        params = DynamicsParams(vehicle=replace(body.vehicle, motor_lag=lag), control=slow)
        if airworthiness.why_not(params.vehicle, params.control, params.wind):
            break
        accepted = params
    vehicle = Vehicle(accepted)
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(round(1000 * PATIENCE))
    assert hypot(*vehicle.velocity) > AT_REST


def test_a_body_that_changes_at_a_landing_stays_on_the_floor():
    """Its motors still turn: at the speed of the old body they lift the new one off the floor."""
    vehicle = Vehicle(DynamicsParams(vehicle=VehicleParams(motor_lag=0.048)))
    vehicle.goto(0.0, 0.0, 0.5)
    vehicle.advance(4000)
    vehicle.goto(0.0, 0.0, 0.0)
    vehicle.advance(100)
    better = VehicleParams(motor_lag=0.048, thrust_coefficient=8 * 1.91e-6)
    vehicle.configure(DynamicsParams(vehicle=better))
    while vehicle.in_force.vehicle != better:
        vehicle.advance(10)
    assert vehicle.standing
    height = vehicle.position[2]
    for _ in range(100):
        vehicle.advance(10)
        assert vehicle.position[2] <= height
        height = vehicle.position[2]
    assert height == 0.0


def test_wind_and_faults_apply_at_once_even_in_flight():
    vehicle = at(z=10.0)
    vehicle.goto(20.0, 0.0, 10.0)
    vehicle.advance(1000)
    windy = DynamicsParams(control=ControlParams(max_speed=1.0))
    windy.wind.mean.y, windy.fault.motors = 3.0, 0.9
    vehicle.configure(windy)
    assert vehicle.wind == (0.0, 3.0, 0.0)
    assert vehicle.in_force.fault.motors == 0.9
    assert vehicle.in_force.control.max_speed == 5.0


def test_a_pending_change_is_dropped_when_the_old_values_return():
    vehicle = at(z=10.0)
    vehicle.goto(20.0, 0.0, 10.0)
    vehicle.advance(1000)
    for speed in (1.0, 5.0):
        vehicle.configure(DynamicsParams(control=ControlParams(max_speed=speed)))
    vehicle.advance(15_000)
    assert vehicle.in_force.control.max_speed == 5.0
