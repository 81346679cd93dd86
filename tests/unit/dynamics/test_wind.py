"""Wind and gusts: exact generators, Dryden's figures, reproducible by seed."""

from itertools import pairwise
from math import dist, exp, hypot, sqrt
from statistics import fmean, pstdev

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from quadctl.schemas.vehicle import RotorDragParams, VehicleParams
from quadctl.services.airspace.airworthiness import BODIES, Body, wind_margin
from quadctl.services.dynamics.controller import PERIOD
from quadctl.services.dynamics.rigidbody import body_constants, step
from quadctl.services.dynamics.rotor import hover_speed
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.dynamics.wind import (
    A1,
    A2,
    A3,
    ESTIMATE_LAG,
    M1,
    M2,
    M3,
    blow,
    follower,
    initial_air,
    noise,
    weather_of,
)
from tests.support.monitored_vehicle import model

LEVEL = (1.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)
OFF = (0.0, 0.0, 0.0, 0.0)


def params(mean=STILL, gust=0.0, length=10.0, seed=0, z=2.0, **vehicle) -> DynamicsParams:
    return DynamicsParams(
        start=StartParams(0.0, 0.0, z),
        wind=WindParams(MeanWindParams(*mean), gust, length),
        seed=seed,
        vehicle=VehicleParams(**vehicle),
    )


def test_the_first_generator_is_that_of_park_and_miller():
    s = 1.0
    for _ in range(10_000):
        s = follower(s, A1, M1)
    assert s == 399268537  # the value that the C++ standard requires of minstd_rand


@pytest.mark.parametrize(("a", "m"), [(A1, M1), (A2, M2), (A3, M3)])
@given(data=st.data())
def test_the_float_generator_equals_the_integer_one(a, m, data):
    s = data.draw(st.integers(1, int(m) - 1))
    assert follower(float(s), a, m) == int(a) * s % int(m)


@pytest.mark.parametrize(("a", "m"), [(A1, M1), (A2, M2), (A3, M3)])
def test_each_generator_visits_all_its_states(a, m):
    """Check that the multiplier a is a primitive root: a ** ((m - 1) / prime) is never 1."""
    left, prime, modulus = int(m) - 1, 2, int(m)
    while left > 1:
        if left % prime == 0:
            assert pow(int(a), (modulus - 1) // prime, modulus) != 1
            while left % prime == 0:
                left //= prime
        prime += 1


def test_noise_is_uncorrelated_with_mean_0_and_variance_1():
    states, drawn = (1.0, 1.0, 1.0), []
    for _ in range(30_000):
        n, *states = noise(*states)
        drawn.append(n)
    assert abs(fmean(drawn)) < 0.03
    assert pstdev(drawn) == pytest.approx(1.0, abs=0.02)
    assert abs(fmean(a * b for a, b in pairwise(drawn))) < 0.03
    assert max(map(abs, drawn)) <= 3.0


def test_gusts_have_the_requested_strength_and_length():
    chosen = params(mean=(3.0, 0.0, 4.0), gust=2.0, length=0.25)
    air, weather, x, z = initial_air(chosen), weather_of(chosen), [], []
    for _ in range(40_000):
        air = blow(air, weather)
        x.append(air[0] - 3.0)
        z.append(air[2] - 4.0)
    assert fmean(x) == pytest.approx(0.0, abs=0.3)
    assert pstdev(x) == pytest.approx(2.0, rel=0.05)
    assert pstdev(z) == pytest.approx(2.0, rel=0.05)
    assert abs(fmean(a * b for a, b in zip(x, z, strict=True))) < 0.4
    lag = 12  # 0.046 s: one length at the speed of wind and gusts, sqrt(29) m/s
    memory = fmean(a * b for a, b in zip(x, x[lag:], strict=False)) / pstdev(x) ** 2
    assert memory == pytest.approx(exp(-lag * PERIOD * sqrt(29) / 0.25), abs=0.06)


def test_no_gust_is_faster_than_four_times_its_rms():
    chosen = params(mean=(3.0, 0.0, 4.0), gust=2.0, length=0.25)
    air, weather, speeds = initial_air(chosen), weather_of(chosen), []
    for _ in range(40_000):
        air = blow(air, weather)
        speeds.append(dist(air[:3], (3.0, 0.0, 4.0)))
    assert 7.9 < max(speeds) <= 8.0 + 1e-9
    boots = [initial_air(params(gust=1.0, seed=seed))[:3] for seed in range(2000)]
    assert 3.5 < max(dist(air, (0.0, 0.0, 0.0)) for air in boots) <= 4.0 + 1e-9


def flight(chosen: DynamicsParams, steps: int = 1000) -> tuple[float, ...]:
    vehicle = Vehicle(chosen)
    vehicle.goto(1.0, 1.0, 2.5)
    vehicle.advance(steps)
    return vehicle.state


def test_the_seed_determines_the_flight():
    flights = [flight(params(gust=1.0, seed=seed)) for seed in (0, 0, 1, 2)]
    assert flights[0] == flights[1]
    assert len(set(flights)) == 3


def test_in_still_air_the_seed_has_no_effect():
    assert flight(params(seed=1)) == flight(params(seed=2))


def test_neighbouring_seeds_start_with_uncorrelated_winds():
    winds = [initial_air(params(gust=1.0, seed=seed))[:3] for seed in range(2000)]
    for axis in range(3):
        drawn = [wind[axis] for wind in winds]
        assert abs(fmean(drawn)) < 0.1
        assert pstdev(drawn) == pytest.approx(1.0, abs=0.06)
        assert abs(fmean(a * b for a, b in pairwise(drawn))) < 0.1


def test_the_vehicle_hovers_on_its_goal_in_a_steady_wind():
    vehicle = Vehicle(params(mean=(5.0, -3.0, 1.0)))
    vehicle.goto(1.0, 0.0, 2.0)
    vehicle.advance(8000)
    assert dist(vehicle.position, (1.0, 0.0, 2.0)) < 1e-3
    assert vehicle.wind == (5.0, -3.0, 1.0)


def test_the_vehicle_stays_near_its_goal_in_gusts():
    vehicle = Vehicle(params(mean=(3.0, 0.0, 0.0), gust=1.5))
    worst = 0.0
    for _ in range(1000):
        before = vehicle.state
        vehicle.advance(20)
        assert vehicle.state != before
        worst = max(worst, dist(vehicle.position, (0.0, 0.0, 2.0)))
    assert 0.001 < worst < 0.15


def test_the_estimate_follows_the_air_with_its_lag():
    chosen = params(mean=(3.0, 0.0, 0.0), gust=1.5)
    air, weather = initial_air(chosen), weather_of(chosen)
    assert air[6:] == air[:3]
    air = (8.0, *air[1:6], 3.0, 0.0, 0.0)
    for _ in range(round(ESTIMATE_LAG / PERIOD)):
        air = blow((8.0, *air[1:]), weather)
    assert air[6] == pytest.approx(8.0 - 5.0 * exp(-1.0))


def test_a_wind_without_gusts_is_known_at_once():
    vehicle = Vehicle(params(gust=1.0))
    vehicle.advance(1000)
    vehicle.configure(params(mean=(4.0, 0.0, 0.0)))
    vehicle.advance(2000)
    assert dist(vehicle.position, (0.0, 0.0, 2.0)) < 0.05


@pytest.mark.thorough
@pytest.mark.parametrize(("wind", "gust"), [(0.5, 0.125), (2.25, 0.5625)])
def test_gusts_move_a_fast_vehicle_little(wind, gust):
    """Check the sideways way off a straight line at 5 m/s: gusts push with the whole speed through the air."""
    worst = 0.0
    for seed in range(20):
        vehicle = Vehicle(params(mean=(0.0, wind, 0.0), gust=gust, seed=seed))
        vehicle.goto(30.0, 0.0, 2.0)
        for _ in range(160):
            vehicle.advance(50)
            worst = max(worst, abs(vehicle.position[1]))
    flies = params(mean=(0.0, wind, 0.0), gust=gust)
    assert worst < 0.5 * (0.01 + wind_margin(flies.vehicle, flies.control, flies.wind))


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.name)
@pytest.mark.parametrize(("wind", "gust"), [(0.0, 0.5), (0.0, 1.5), (3.0, 0.75), (4.0, 0.0)])
def test_wind_moves_a_vehicle_less_than_it_adds_to_the_margin(body: Body, wind: float, gust: float):
    margin = wind_margin(body.vehicle, body.control, WindParams(MeanWindParams(wind), gust))
    worst = 0.0
    for seed, height in ((1, 0.0), (2, 2.0)):  # it leaves the floor, or hovers
        chosen = params(mean=(wind, 0.0, 0.0), gust=gust, seed=seed, z=height)
        vehicle = Vehicle(replace(chosen, vehicle=body.vehicle, control=body.control))
        vehicle.fly = model()
        vehicle.goto(0.0, 0.0, 2.0)
        for _ in range(3000):
            vehicle.advance(10)
            worst = max(worst, hypot(*vehicle.position[:2]))
    assert 0.02 * margin < worst < margin


def test_gusts_do_not_move_a_vehicle_on_the_floor():
    vehicle = Vehicle(params(mean=(5.0, 0.0, -1.0), gust=1.5, z=0.0))
    for _ in range(300):
        vehicle.advance(10)
        assert vehicle.position[2] == 0.0
    assert vehicle.standing
    assert dist(vehicle.position, STILL) < 1e-3
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(5000)
    assert dist(vehicle.position, (0.0, 0.0, 1.0)) < 0.5


def test_a_change_of_wind_in_flight_takes_effect():
    vehicle = Vehicle(params())
    vehicle.advance(1000)
    resting = vehicle.state
    vehicle.configure(params(mean=(4.0, 0.0, 0.0)))
    vehicle.advance(2000)
    assert vehicle.wind == (4.0, 0.0, 0.0)
    assert vehicle.state != resting
    assert dist(vehicle.position, (0.0, 0.0, 2.0)) < 0.05
    vehicle.configure(params())
    vehicle.advance(10_000)
    assert vehicle.wind == STILL
    assert vehicle.state == pytest.approx(resting, abs=1e-6)


def test_linear_drag_matches_the_closed_form_velocity():
    body = body_constants(VehicleParams(drag=0.0, linear_drag=0.5))
    state = (0.0, 0.0, 9000.0, *STILL, *LEVEL, *STILL, *OFF)
    for _ in range(3000):
        state = step(state, OFF, STILL, body)
    assert state[5] == pytest.approx(-9.81 / 0.5 * (1.0 - exp(-0.5 * 3.0)), rel=1e-12)


def test_rotor_drag_acts_across_and_along_the_rotor_axes():
    vehicle = VehicleParams(drag=0.0, gravity=0.0, rotor_drag=RotorDragParams(1e-4, 2e-5))
    turning = (hover_speed(VehicleParams()),) * 4
    state = (0.0, 0.0, 100.0, *STILL, *LEVEL, *STILL, *turning)
    body, h = body_constants(vehicle, 1e-6), 1e-6
    wind = (1.0, 0.0, 2.0)
    vx, vy, vz = step(state, turning, wind, body)[3:6]
    assert vx / h == pytest.approx(1e-4 * 4 * turning[0] * 1.0, rel=1e-5)
    assert vy == 0.0
    assert vz / h - 9.81 == pytest.approx(2e-5 * 4 * turning[0] * 2.0, rel=1e-4)


def test_rotor_and_linear_drag_are_fed_forward():
    vehicle = Vehicle(params(z=10.0, linear_drag=0.1, rotor_drag=RotorDragParams(5e-5, 3e-5)))
    vehicle.goto(30.0, 10.0, 10.0)
    for _ in range(2000):
        vehicle.advance(4)
        assert dist(vehicle.position, vehicle.setpoint) < 0.03
