"""Vehicles that are refused because they could not hold their place."""

from math import exp, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from quadctl.schemas.params import MeanWindParams, WindParams
from quadctl.schemas.vehicle import ControlParams, InertiaParams, VehicleParams
from quadctl.services.airspace import airworthiness
from quadctl.services.dynamics.controller import LEAST_LIFT, MOST_LIFT, PERIOD
from quadctl.services.dynamics.wind import ESTIMATE_LAG
from quadctl.services.runtime.params.load import load

ROOT = Path(__file__).parents[3]
GAIN = st.floats(-2, 3).map(lambda power: 10**power)


def reason_against(vehicle=None, control=None, wind=None) -> str:
    return airworthiness.why_not(
        vehicle or VehicleParams(), control or ControlParams(), wind or WindParams()
    )


def blowing(speed: float) -> WindParams:
    return WindParams(MeanWindParams(0.6 * speed, 0.8 * speed))


def test_the_constants_are_those_of_the_controller():
    assert (airworthiness.CONTROL_PERIOD, airworthiness._ESTIMATED) == (PERIOD, ESTIMATE_LAG)
    assert (MOST_LIFT, pytest.approx(1 - LEAST_LIFT)) == (airworthiness._LIFT, airworthiness._SINK)


@settings(max_examples=300)
@given(GAIN, GAIN, GAIN, GAIN, st.floats(0.001, 10))
def test_the_damping_equals_that_of_numpys_roots(kp, kv, ka, kr, lag):
    control = ControlParams(kp, kv, ka, kr)
    delay = lag + 0.002
    roots = np.roots([delay, 1, kr, kr * ka, kr * ka * kv, kr * ka * kv * kp])
    found = airworthiness.damping(VehicleParams(motor_lag=lag), control)
    assert found == pytest.approx(min(-roots.real / abs(roots)), abs=1e-5)


@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-9, 1e-7, -1e-6])
def test_the_damping_of_five_equal_modes_is_found_as_well(off):
    # The loop is (s + 9.5238)^5 / 9.5238^4: its roots are known to the fifth root of a float's precision.
    control = ControlParams(40 / 21, 100 / 21, 200 / 21, 400 / 21 * (1 + off))
    assert airworthiness.damping(VehicleParams(motor_lag=0.019), control) > 0.9
    rounded = ControlParams(1.9047619, 4.7619048, 9.5238095, 19.047619)
    found = airworthiness.damping(VehicleParams(motor_lag=0.019), rounded)
    assert found == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("vehicle", "control", "wind"),
    [
        ({}, {}, 0.0),
        ({"motor_lag": 0.04}, {}, 0.0),
        ({}, {"position_gain": 2.4}, 0.0),
        ({}, {"velocity_gain": 6.0}, 0.0),
        ({"mass": 2.0}, {}, 0.0),
        ({}, {"max_tilt": 0.05}, 0.0),
        ({}, {}, 8.5),
    ],
)
def test_an_airworthy_vehicle_is_accepted(vehicle, control, wind):
    body = VehicleParams(**vehicle), ControlParams(**control)
    assert reason_against(*body, blowing(wind)) == ""
    assert airworthiness.why_unproven(*body) == ""


def test_every_body_of_the_table_and_of_the_examples_flies_with_a_promise():
    for body in airworthiness.BODIES:
        assert airworthiness.why_not(body.vehicle, body.control, WindParams()) == ""
        assert airworthiness.why_unproven(body.vehicle, body.control) == ""
    crazyflie = load(ROOT / "examples/crazyflie.toml").dynamics
    assert airworthiness.BODIES[1][1:] == (crazyflie.vehicle, crazyflie.control)


@pytest.mark.parametrize(
    ("vehicle", "control", "far"),
    [
        ({"mass": 2.01}, {}, "mass 2.01 is not within 0.5 to 2: no promise holds so far from the lab's"),
        ({"mass": 0.015}, {}, "mass"),
        ({"inertia": InertiaParams(z=0.02)}, {}, "inertia.z 0.02 is not within"),
        ({}, {"rate_gain": 43.0}, "rate_gain 43 is not within 18.7 to 42"),
        ({}, {"max_jerk": 4.9}, "max_jerk 4.9 is not within 5 to inf"),
        ({"gravity": 0.0}, {"position_gain": 1.0}, "gravity 0 is not within 4.91 to 19.6, position_gain 1"),
    ],
)  # fmt: skip
def test_a_parameter_too_far_from_every_body_has_no_promise(vehicle, control, far):
    body = VehicleParams(**vehicle), ControlParams(**control)
    assert airworthiness.why_unproven(*body).startswith(far)
    assert far in airworthiness.limited(*body, WindParams())[0]


@pytest.mark.parametrize(
    ("vehicle", "control", "wind", "reason"),
    [
        ({"motor_lag": 0.1}, {}, 0.0, "unstable"),
        ({"motor_lag": 0.5}, {}, 0.0, "unstable"),
        ({"motor_lag": 0.06}, {}, 0.0, "hardly damped"),
        ({}, {"velocity_gain": 0.3}, 0.0, "hardly damped"),
        ({"drag": 100.0}, {"max_tilt": 0.05}, 0.0, "against the air it flies at 0.0"),
        ({}, {}, 9.0, "against the air it flies at 0.042 m/s at most"),
        ({}, {"max_tilt": 0.02}, 0.0, "it speeds up with 0.18 m/s^2 at most, below 0.2"),
        ({}, {"attitude_gain": 30.0}, 0.0, "hardly damped"),
        ({}, {"max_jerk": 0.13}, 0.0, "a jerk of 0.13 m/s^3 it takes 1.1 s to take off, above 1"),
        ({}, {"position_gain": 100.0}, 0.0, "unstable"),
        ({"mass": 4.0}, {}, 0.0, "its motors lift 8.32 m/s^2"),
        ({"max_motor_speed": 100.0}, {}, 0.0, "its motors lift"),
        ({"gravity": 0.0}, {}, 0.0, "without gravity"),
        ({"inertia": InertiaParams(z=0.02)}, {}, 0.0, "no body has this inertia"),
        ({}, {}, 9.2, "wind of 9.2 m/s pushes by 8.46 m/s^2, max_tilt holds 8.26"),
    ],
)
def test_a_vehicle_that_cannot_hover_is_refused(vehicle, control, wind, reason):
    found = reason_against(VehicleParams(**vehicle), ControlParams(**control), blowing(wind))
    assert reason in found


def test_a_table_changed_in_place_is_judged_by_its_new_values():
    vehicle = VehicleParams()
    body = vehicle, ControlParams(), WindParams()
    before, damped = airworthiness.flown(*body), airworthiness.damping(*body[:2])
    vehicle.drag, vehicle.motor_lag = 0.5, 0.09
    assert airworthiness.flown(*body).max_speed < before.max_speed
    assert airworthiness.damping(*body[:2]) < damped
    vehicle.drag, vehicle.motor_lag = VehicleParams().drag, VehicleParams().motor_lag
    assert airworthiness.flown(*body) == before


def test_a_body_without_gravity_has_no_limits_to_fly():
    limits = airworthiness.flown(VehicleParams(gravity=0.0), ControlParams(), WindParams())
    assert limits == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_gusts_of_four_times_their_strength_count_as_wind():
    wind = WindParams(MeanWindParams(5.0), gust=1.05)
    assert "wind of 9.2 m/s" in reason_against(wind=wind)


def test_gusts_that_leave_too_little_to_correct_what_they_do_are_refused():
    assert reason_against(wind=WindParams(gust=2.0)) == ""
    assert "wind of 8.4 m/s" in reason_against(wind=WindParams(gust=2.1))


def test_the_wind_adds_to_the_margin_with_its_mean_and_its_gusts():
    def margin(mean: float, gust: float) -> float:
        wind = WindParams(MeanWindParams(mean), gust)
        return airworthiness.wind_margin(VehicleParams(), ControlParams(), wind)

    assert margin(0.0, 0.0) == 0
    damped = airworthiness.damping(VehicleParams(), ControlParams())
    blown = 0.1 * 5**2 / 9.0 * (1 + exp(-pi * damped / sqrt(1 - damped**2)))
    spare = airworthiness._spare(VehicleParams(), ControlParams(), 5.0, 0.0)
    assert margin(5.0, 0.0) == pytest.approx(blown / 4.0 + blown**2 / (2 * spare[0]))
    assert margin(0.0, 0.5) < margin(0.0, 1.0) < margin(3.0, 1.0)


def test_a_change_of_wind_adds_to_the_margin_as_it_pushes():
    def margin(wind: WindParams, *before: WindParams) -> float:
        return airworthiness.wind_margin(VehicleParams(), ControlParams(), wind, before)

    calm, east, west = (WindParams(MeanWindParams(x)) for x in (0.0, 5.0, -5.0))
    assert margin(east, calm) == margin(east, east) == margin(east)
    north = WindParams(MeanWindParams(y=5.0))
    assert (
        margin(east) < margin(east, north) < margin(east, west) == margin(east, calm, west, north)
    )
    assert margin(calm, west) == pytest.approx(margin(east), rel=0.2)
    push = airworthiness._push
    assert push(VehicleParams(), west, east) == pytest.approx(2 * push(VehicleParams(), calm, east))
    # Gusts that end were the strongest just before.
    assert push(VehicleParams(), WindParams(gust=1.0), calm) == pytest.approx(0.1 * 4.0**2)


def test_in_gusts_a_new_wind_has_to_be_learnt():
    gusty = WindParams(MeanWindParams(5.0), 1e-9)
    body = VehicleParams(), ControlParams(), gusty
    learnt = airworthiness.wind_margin(*body, [WindParams(gust=1e-9)])
    push = airworthiness._push(VehicleParams(), WindParams(), gusty)
    least = airworthiness.wind_margin(*body) + airworthiness._ESTIMATED * push / 4.0
    assert least < learnt < 1.5 * least


def test_wind_upwards_counts_as_lift():
    assert "the air lifts it by 10 m/s^2" in reason_against(wind=WindParams(MeanWindParams(z=10.0)))
    assert reason_against(wind=WindParams(MeanWindParams(z=-5.0))) == ""


@pytest.mark.parametrize(
    ("vehicle", "control", "wind", "lines"),
    [
        ({}, {}, 0.0, []),
        ({}, {"max_acceleration": 20.0}, 0.0, ["can do 6.3 m/s^2, flown with 5.7"]),
        ({}, {"max_tilt": 0.3}, 0.0, ["can do 2.9 m/s^2, flown with 2.6", "max_speed 5: against"]),
        ({"drag": 50.0}, {}, 0.0, ["max_speed 5: against the air flown with 0.02", "max_jerk"]),
        (
            {"mass": 3.0},
            {},
            0.0,
            ["mass 3 is not", "can do 1.3 m/s^2, flown with 1", "max_speed", "max_jerk 40: for"],
        ),
        ({}, {"max_jerk": 200.0}, 0.0, ["max_jerk 200: for its torque flown with 42"]),
        ({}, {"max_tilt": 1.4}, 0.0, ["max_tilt 1.4: for its torque flown with 0.95"]),
        (
            {},
            {"position_gain": 0.4, "velocity_gain": 0.25},
            0.0,
            [
                "position_gain 0.4 is not",
                "max_acceleration 5: for its drag and the motors' lag flown with 1.8",
                "max_speed 5: against the air flown with 0.62",
            ],
        ),
        (
            {},
            {},
            8.0,
            ["the wind adds", "max_acceleration 5: the body can do 1.4 m/s^2", "max_speed"],
        ),
        ({}, {}, 10.0, ["it cannot hold itself: wind of 10 m/s"]),
    ],
)
def test_each_limit_that_is_lowered_has_its_line(vehicle, control, wind, lines):
    told = airworthiness.limited(VehicleParams(**vehicle), ControlParams(**control), blowing(wind))
    assert len(told) == len(lines), told
    assert all(line in said for line, said in zip(lines, told, strict=True)), told


def test_in_a_wind_beyond_the_envelope_the_limits_are_those_of_still_air():
    body = VehicleParams(), ControlParams(max_acceleration=20.0)
    assert airworthiness.flown(*body, blowing(12.0)) == airworthiness.flown(*body, WindParams())
