"""Mixer: exact for a feasible wrench, and the right priorities otherwise."""

from math import sqrt

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.vehicle import VehicleParams
from quadctl.services.dynamics.rigidbody import Motors, State, body_constants, step
from quadctl.services.dynamics.rotor import hover_speed, mix, mixer_constants

PERIOD = 0.004
VEHICLE = VehicleParams()
MIXER = mixer_constants(VEHICLE, PERIOD)
FULL = VEHICLE.thrust_coefficient * VEHICLE.max_motor_speed**2
HALF = (sqrt(0.5 * FULL / VEHICLE.thrust_coefficient),) * 4
AIR: State = (0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def steady(thrust: float, tx: float, ty: float, tz: float) -> Motors:
    """Return the motor speeds after commanding the same wrench until they settle."""
    motors: Motors = (1000.0, 1000.0, 1000.0, 1000.0)
    body = body_constants(VEHICLE)
    for _ in range(150):
        command = mix(thrust, tx, ty, tz, (*AIR, *motors), MIXER)
        state: State = (*AIR, *motors)
        for _ in range(4):
            state = step(state, command, (0.0, 0.0, 0.0), body)
        motors = (state[13], state[14], state[15], state[16])
    return motors


def wrench(motors: Motors) -> tuple[float, float, float, float]:
    """Return thrust and torques of four rotors in the X frame, as a sum over rotors."""
    lever = VEHICLE.arm / sqrt(2)
    places = ((lever, lever, 1), (-lever, lever, -1), (-lever, -lever, 1), (lever, -lever, -1))
    forces = [VEHICLE.thrust_coefficient * m * m for m in motors]
    return (
        sum(forces),
        sum(f * y for f, (_, y, _) in zip(forces, places, strict=True)),
        sum(-f * x for f, (x, _, _) in zip(forces, places, strict=True)),
        sum(
            VEHICLE.torque_coefficient * m * m * s
            for m, (_, _, s) in zip(motors, places, strict=True)
        ),
    )


@pytest.mark.thorough
@given(st.floats(15, 22), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.15, 0.15))
def test_a_feasible_wrench_is_produced_exactly(thrust, tx, ty, tz):
    assert wrench(steady(thrust, tx, ty, tz)) == pytest.approx((thrust, tx, ty, tz), abs=1e-9)


@pytest.mark.thorough
@given(st.floats(-50, 100), st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_roll_and_pitch_have_priority_over_thrust_and_yaw(thrust, tx, ty, tz):
    _, roll, pitch, yaw = wrench(steady(thrust, tx, ty, tz))
    fits = (abs(tx) + abs(ty)) * sqrt(2) / VEHICLE.arm / 4 <= 0.5 * FULL
    if fits:
        assert (roll, pitch) == pytest.approx((tx, ty), abs=1e-6)
    else:
        assert roll * ty == pytest.approx(pitch * tx, abs=1e-6)
    assert -1e-6 <= yaw * tz <= tz * tz + 1e-6


@given(
    st.floats(-50, 100), st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2),
    st.lists(st.floats(0, 2200), min_size=4, max_size=4),
)  # fmt: skip
def test_commands_stay_within_the_motor_speed_limits(thrust, tx, ty, tz, motors):
    for speed in mix(thrust, tx, ty, tz, (*AIR, *motors), MIXER):
        assert 0.0 <= speed <= VEHICLE.max_motor_speed


def test_the_thrust_is_kept_while_rotor_speeds_diverge():
    motors: Motors = HALF
    command = mix(2 * FULL, 0.3, 0.0, 0.0, (*AIR, *motors), MIXER)
    state: State = (*AIR, *motors)
    for _ in range(4):
        state = step(state, command, (0.0, 0.0, 0.0), body_constants(VEHICLE))
    assert wrench((state[13], state[14], state[15], state[16]))[0] == pytest.approx(
        2 * FULL, rel=1e-12
    )


def test_the_hover_speed_carries_the_weight_or_is_the_limit():
    assert wrench((hover_speed(VEHICLE),) * 4)[0] == pytest.approx(9.81)
    assert hover_speed(VehicleParams(mass=100.0)) == 2200.0
