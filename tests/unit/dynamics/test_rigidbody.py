"""Rigid body and motors against closed forms, conservation laws and DOP853.

The reference states were made with scipy's DOP853 at rtol 1e-13 from a second, independently
written right-hand side (matrices, four explicit rotor positions).
"""

from math import asin, cosh, dist, exp, log, sqrt, tanh

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.vehicle import InertiaParams, VehicleParams
from quadctl.services.dynamics.rigidbody import STEP, Body, Motors, State, body_constants, step

LEVEL = (1.0, 0.0, 0.0, 0.0)
OFF: Motors = (0.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)
TUMBLER = VehicleParams(inertia=InertiaParams(0.004, 0.0049, 0.0069), gravity=0.0, drag=0.0)
TUMBLE = (0.0, 0.0, 1000.0, *STILL, *LEVEL, 3.0, 0.1, 4.0, *OFF)


def run(
    state: State,
    steps: int,
    body: Body,
    command: Motors = OFF,
    wind: tuple[float, float, float] = STILL,
) -> State:
    for _ in range(steps):
        state = step(state, command, wind, body)
    return state


def at(height: float, velocity: tuple[float, float, float] = STILL, motors: Motors = OFF) -> State:
    return (0.0, 0.0, height, *velocity, *LEVEL, *STILL, *motors)


def momentum_and_energy(state: State, vehicle: VehicleParams) -> tuple[tuple[float, ...], float]:
    w, x, y, z = state[6:10]
    a, b, c = state[10:13]
    inertia = vehicle.inertia
    la, lb, lc = inertia.x * a, inertia.y * b, inertia.z * c
    world = (
        (1 - 2 * (y * y + z * z)) * la + 2 * (x * y - w * z) * lb + 2 * (x * z + w * y) * lc,
        2 * (x * y + w * z) * la + (1 - 2 * (x * x + z * z)) * lb + 2 * (y * z - w * x) * lc,
        2 * (x * z - w * y) * la + 2 * (y * z + w * x) * lb + (1 - 2 * (x * x + y * y)) * lc,
    )
    return world, 0.5 * (la * a + lb * b + lc * c)


def test_a_tumble_keeps_energy_and_momentum():
    before, energy = momentum_and_energy(TUMBLE, TUMBLER)
    after, energy_after = momentum_and_energy(run(TUMBLE, 10_000, body_constants(TUMBLER)), TUMBLER)
    assert abs(energy_after / energy - 1) < 1e-10
    assert dist(before, after) < 1e-8 * dist(before, STILL)


def test_the_tumble_ends_in_the_attitude_of_dop853():
    reference = (
        -0.3261553176214105,
        -0.17995646218488814,
        -0.3410710443773908,
        -0.8630810640910226,
    )
    attitude = run(TUMBLE, 10_000, body_constants(TUMBLER))[6:10]
    assert 2 * asin(dist(attitude, reference) / 2) * 2 < 1e-8


def test_open_loop_with_drag_wind_and_motor_lag_matches_dop853():
    reference = (
        -0.4385601072459294, -1.6026501037956262, 993.5515805979916,
        -0.659817851422163, -1.6040191998205935, -8.793392296108438,
        0.2417571639683757, -0.13674019805003, 0.9587781063006577, -0.06000112320391358,
        1.7884650584688935, -10.10011999008321, 0.030579710144938918,
    )  # fmt: skip
    start = (1.0, 2.0, 1000.0, 1.0, -2.0, 0.5, *LEVEL, 0.1, 0.2, 0.3, 900.0, 1000.0, 1100.0, 1200.0)
    command = (1210.0, 1160.0, 1150.0, 1200.0)
    end = run(start, 2000, body_constants(VehicleParams()), command, (2.0, -1.0, 0.5))
    assert dist(end[:3], reference[:3]) < 2e-9
    assert dist(end[:13], reference) < 2e-9


def test_halving_the_step_reduces_the_error_sixteenfold():
    motors = (1300.0, 1100.0, 1250.0, 1050.0)
    start = (0.0, 0.0, 1000.0, 1.0, 2.0, 3.0, *LEVEL, 1.0, 2.0, 3.0, *motors)

    def end(divider: int) -> State:
        body = body_constants(VehicleParams(), 0.008 / divider)
        return run(start, 125 * divider, body, motors)[:13]

    exact = end(32)
    assert dist(end(1), exact) / dist(end(2), exact) == pytest.approx(16, abs=1)


def test_free_fall_is_a_parabola():
    body = body_constants(VehicleParams(drag=0.0))
    end = run(at(1000.0, (1.0, -2.0, 3.0)), 5000, body)
    assert end[:3] == pytest.approx((5.0, -10.0, 1015.0 - 0.5 * 9.81 * 25), rel=1e-12)
    assert end[3:6] == pytest.approx((1.0, -2.0, 3.0 - 9.81 * 5), rel=1e-12)


def test_a_fall_with_drag_follows_tanh_to_terminal_velocity():
    terminal = sqrt(9.81 / 0.1)
    end = run(at(1000.0), 4000, body_constants(VehicleParams()))
    fall = log(cosh(9.81 * 4 / terminal)) / 0.1
    assert end[5] == pytest.approx(-terminal * tanh(9.81 * 4 / terminal), rel=1e-10)
    assert end[2] == pytest.approx(1000.0 - fall, rel=1e-10)
    long = run(at(9000.0), 20_000, body_constants(VehicleParams()))
    assert long[5] == pytest.approx(-terminal, rel=1e-12)


def test_hover_speed_holds_for_a_minute():
    speed = sqrt(9.81 / 4 / 1.91e-6)
    command = (speed, speed, speed, speed)
    end = run(at(1.0, motors=command), 60_000, body_constants(VehicleParams()), command)
    assert end[:13] == pytest.approx(at(1.0)[:13], abs=1e-10)


def test_after_one_lag_a_motor_is_1_over_e_from_its_command():
    end = run(at(1000.0), 20, body_constants(VehicleParams()), (2200.0, 1000.0, 0.0, 5.0))
    assert end[13:] == pytest.approx(
        [c * (1 - exp(-1)) for c in (2200.0, 1000.0, 0.0, 5.0)], rel=1e-13
    )


def test_a_vehicle_moving_with_the_air_has_no_drag():
    body = body_constants(VehicleParams(gravity=0.0))
    wind = (3.0, -2.0, 1.0)
    assert run(at(1000.0, wind), 100, body, wind=wind)[3:6] == wind
    blown = run(at(1000.0), 1, body, wind=wind)[3:6]
    speed = dist(wind, STILL)
    assert blown == pytest.approx([0.1 * speed * u * STEP for u in wind], rel=1e-2)


@pytest.mark.parametrize(
    ("faster", "sign"),
    [((0, 1), (1, 0, 0)), ((1, 2), (0, 1, 0)), ((0, 2), (0, 0, 1))],
    ids=["left rolls right side down", "rear pitches nose down", "first and third yaw left"],
)
def test_rotors_turn_the_body_in_the_right_direction(faster, sign):
    motors = tuple(1200.0 if k in faster else 1100.0 for k in range(4))
    rates = run(at(10.0, motors=motors), 1, body_constants(VehicleParams()), motors)[10:13]
    assert [(rate > 1e-9) - (rate < -1e-9) for rate in rates] == list(sign)


def test_a_dropped_vehicle_comes_to_rest_on_the_floor():
    dropped = (0.0, 0.0, 0.5, 1.0, -1.0, 0.0, *LEVEL, 1.0, 2.0, 3.0, *OFF)
    end = run(dropped, 1000, body_constants(VehicleParams()))
    assert end[2] == 0.0
    assert end[3:6] == STILL
    assert end[10:13] == STILL


@given(
    st.floats(0, 0.01), st.lists(st.floats(-20, 20), min_size=6, max_size=6),
    st.lists(st.floats(0, 2200), min_size=4, max_size=4),
)  # fmt: skip
def test_the_height_is_never_negative_and_the_quaternion_stays_normal(height, motion, motors):
    state = (0.0, 0.0, height, *motion[:3], *LEVEL, *motion[3:], *motors)
    body = body_constants(VehicleParams())
    for _ in range(20):
        state = step(state, OFF, STILL, body)
        assert state[2] >= 0.0
        assert abs(dist(state[6:10], (0.0, 0.0, 0.0, 0.0)) - 1) < 1e-15


def test_contact_levels_a_vehicle_and_keeps_its_heading():
    tilted = (0.5, 0.5, -0.5, 0.5)
    *_, w, x, y, z = run(
        (0.0, 0.0, 0.0, *STILL, *tilted, *STILL, *OFF), 1, body_constants(VehicleParams())
    )[:10]
    assert (x, y) == (0.0, 0.0)
    assert (w, z) == pytest.approx((sqrt(0.5), sqrt(0.5)))


def test_a_vehicle_on_its_back_stays_there():
    over = (0.0, 0.6, 0.8, 0.0)
    after = run((0.0, 0.0, 0.0, *STILL, *over, *STILL, *OFF), 1, body_constants(VehicleParams()))
    assert after[6:10] == pytest.approx(over)
