"""Tracking error on a smooth setpoint: the benefit of feed-forward."""

from math import cos, dist, sin
from typing import Any

import pytest

from quadctl.schemas.params import DynamicsParams, FlightFaultParams, StartParams
from quadctl.schemas.vehicle import ControlParams, RotorDragParams, VehicleParams
from quadctl.services.dynamics.controller import PERIOD, STEPS
from quadctl.services.dynamics.flight_modes import motor_commands
from quadctl.services.dynamics.rigidbody import step
from quadctl.services.dynamics.vehicle import Vehicle, constants_of, initial

CALM = (0.0, 0.0, 0.0)


def circle(radius: float, speed: float, t: float) -> tuple[float, ...]:
    """Return position to crackle on a circle 10 m up."""
    w = speed / radius
    c, s = cos(w * t), sin(w * t)
    return (
        radius * c, radius * s, 10.0,
        -radius * w * s, radius * w * c, 0.0,
        -radius * w**2 * c, -radius * w**2 * s, 0.0,
        radius * w**3 * s, -radius * w**3 * c, 0.0,
        radius * w**4 * c, radius * w**4 * s, 0.0,
        -radius * w**5 * s, radius * w**5 * c, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(("jerk", "within"), [(True, 0.03), (False, 1.0)])
def test_circle_at_4_m_per_s_is_tracked_within_3_cm(jerk, within):
    params = DynamicsParams(start=StartParams(4.0, 0.0, 10.0))
    body, gains, mixer, _, weight, _, _ = constants_of(params)
    state, command, *_ = initial(params)
    state = (*state[:3], 0.0, 4.0, 0.0, *state[6:])
    errors = []
    for number in range(3000):
        t = number * PERIOD
        wanted = circle(4.0, 4.0, t)
        errors.append(dist(state[:3], wanted[:3]))
        if not jerk:
            wanted = (*wanted[:9], *(0.0,) * 9)
        command = motor_commands(state, wanted, 2.0, weight, gains, mixer, (0.0, 0.0, 0.0))
        for _ in range(STEPS):
            state = step(state, command, CALM, body)
    settled = max(errors[1500:])
    assert settled < within
    # Without jerk as body rates and snap as torque the error is larger: the test can fail.
    assert jerk or settled > 0.06


def test_one_metre_move_is_tracked_within_1_mm_without_overshoot():
    vehicle = Vehicle(DynamicsParams(start=StartParams(0.0, 0.0, 10.0)))
    vehicle.goto(1.0, 0.0, 10.0)
    off, furthest = 0.0, 0.0
    for _ in range(800):
        vehicle.advance(4)
        off = max(off, dist(vehicle.position, vehicle.setpoint))
        furthest = max(furthest, vehicle.position[0])
    assert off < 0.001
    assert furthest < 1.0 + 1e-4
    assert dist(vehicle.position, (1.0, 0.0, 10.0)) < 1e-4


def test_a_goal_moved_in_flight_does_not_jerk_the_vehicle():
    vehicle = Vehicle(DynamicsParams(start=StartParams(0.0, 0.0, 10.0)))
    jerks = []
    before, last = vehicle.velocity, (0.0, 0.0, 0.0)
    for number in range(2500):
        if number % 250 == 0:
            vehicle.goto(4.0 * cos(number), 4.0 * sin(number), 10.0 + sin(2.0 * number))
        vehicle.advance(STEPS)
        assert dist(vehicle.position, vehicle.setpoint) < 0.05
        now = tuple((a - b) / PERIOD for a, b in zip(vehicle.velocity, before, strict=True))
        jerks.append(dist(now, last) / PERIOD)
        before, last = vehicle.velocity, now
    # The setpoint's jerk is at most 40 m/s^3, shared by three axes; nothing adds a step to it.
    assert max(jerks) < 2.0 * 40.0


ZIGZAG = {0: (0.9, 0.3, 9.1), 350: (-0.9, 0.0, 10.9), 800: (0.9, -0.3, 9.1), 1200: (0.0, 0.0, 10.0)}
"""Goals by the time (ms) at which each replaces the one before."""


@pytest.mark.parametrize(
    ("body", "within"),
    [
        ({}, 0.0005),
        ({"drag": 1.0}, 0.002),
        ({"rotor_drag": RotorDragParams(1e-4)}, 0.001),
        ({"rotor_drag": RotorDragParams(0.0, 1e-4)}, 0.001),
        ({"motor_lag": 0.04}, 0.001),
        # Next to no torque about z: the vehicle yaws as it likes.
        ({"torque_coefficient": 1e-10}, 0.01),
    ],
)
def test_turns_on_all_axes_are_tracked_within_millimetres(body: dict[str, Any], within: float):
    """A missing term of the feed-forward costs 3 to 14 mm here."""
    vehicle = Vehicle(
        DynamicsParams(start=StartParams(0.0, 0.0, 10.0), vehicle=VehicleParams(**body))
    )
    off = 0.0
    for now in range(0, 3000, STEPS):
        if now in ZIGZAG:
            vehicle.goto(*ZIGZAG[now])
        vehicle.advance(STEPS)
        off = max(off, dist(vehicle.position, vehicle.setpoint))
    assert off < within


TURN = {
    1500: (-0.03575, -0.25, 0.20743), 1750: (0.17414, -0.25, 0.0), 3250: (-0.1062, 0.01613, 0.5),
    4300: (-0.25, 0.25, 0.5), 5800: (-0.18261, 0.25, 0.29933),
}  # fmt: skip
"""Goals by the time (ms), found by a search: a climb that turns to the side before it has stopped."""


@pytest.mark.parametrize("lag", [0.02, 0.03, 0.042, 0.044, 0.046, 0.048])
def test_slow_motors_do_not_swing_after_a_turn(lag: float):
    """Behind a setpoint that turns as fast as its motors, it is up to 17 mm off."""
    body = VehicleParams(motor_lag=lag)
    vehicle = Vehicle(DynamicsParams(start=StartParams(0.00714, -0.25, 0.0), vehicle=body))
    off = 0.0
    for now in range(0, 6000, 50):
        if now in TURN:
            vehicle.goto(*TURN[now])
        vehicle.advance(50)
        off = max(off, dist(vehicle.position, vehicle.setpoint))
    assert off < 0.004


SOFT = ControlParams(velocity_gain=1.0)
SLOW = ControlParams(position_gain=0.6, velocity_gain=2.0, attitude_gain=4.5, rate_gain=14.0)


@pytest.mark.parametrize(
    ("control", "lag"),
    [(ControlParams(), 0.02), (SOFT, 0.02), (SLOW, 0.04)],
    ids=["default", "soft", "slow motors"],
)
@pytest.mark.parametrize("goal", [(1.77, 0.96, 0.12), (1.99, 1.17, 0.55), (1.0, 2.0, 1.0)])
def test_a_slanted_take_off_loses_no_speed_to_the_floor(
    control: ControlParams, lag: float, goal: tuple[float, float, float]
):
    # What is lost goes on as an error of the place: 29 mm were seen with slow motors.
    params = DynamicsParams(control=control, vehicle=VehicleParams(motor_lag=lag))
    vehicle = Vehicle(params)
    vehicle.goto(*goal)
    off = 0.0
    while not vehicle.setpoint_rests:
        vehicle.advance(4)
        off = max(off, dist(vehicle.position[:2], vehicle.setpoint[:2]))
    assert off < 0.007


@pytest.mark.thorough
@pytest.mark.parametrize("height", [0.001, 0.002, 0.003, 0.005])
def test_a_climb_from_the_touch_of_the_floor_does_not_jump_off(height: float):
    # Its motors are a little weak, so it touches the floor before its setpoint turns up.
    vehicle = Vehicle(
        DynamicsParams(
            start=StartParams(0.0, 0.0, 0.5),
            control=ControlParams(position_gain=0.4, velocity_gain=1.0),
            fault=FlightFaultParams(motors=0.99995),
        )
    )
    vehicle.advance(20_000)
    vehicle.goto(0.0, 0.0, 0.0)
    while vehicle.setpoint[2] > height:
        vehicle.advance(4)
    vehicle.goto(0.0, 0.0, 0.5)
    off = 0.0
    while not vehicle.setpoint_rests:
        vehicle.advance(4)
        off = max(off, dist(vehicle.position, vehicle.setpoint))
    assert off < 0.003


@pytest.mark.parametrize("height", [0.003, 0.009, 0.03, 0.08])
@pytest.mark.parametrize("then", [0.0, 0.05, 0.26])
def test_a_goal_beside_a_landing_does_not_move_it_to_the_side(height: float, then: float):
    # Near the floor a way to the side of 9 mm, given and taken back, became 38 mm out of a cage.
    vehicle = Vehicle(
        DynamicsParams(start=StartParams(0.0, 0.0, 0.5), control=ControlParams(attitude_gain=4.3))
    )
    vehicle.goto(0.0, 0.0, 0.0)
    while vehicle.setpoint[2] > height:
        vehicle.advance(4)
    vehicle.goto(0.009, 0.0, 0.0)
    vehicle.advance(52)
    vehicle.goto(0.0, 0.0, then)
    while not vehicle.setpoint_rests:
        vehicle.advance(4)
        assert abs(vehicle.position[0]) < 0.0005
    assert vehicle.position[2] == pytest.approx(then, abs=0.001)
