"""Control cascade: at rest on its setpoint, correct signs away from it, within its limits."""

from math import atan2, cos, sin

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.vehicle import VehicleParams
from quadctl.services.dynamics.controller import control, control_constants, specific_force
from quadctl.services.dynamics.rigidbody import State

PARAMS = DynamicsParams()
GAINS = control_constants(PARAMS)
CALM = (0.0, 0.0, 0.0)
METRES = st.floats(-1000, 1000)
VECTOR = st.tuples(METRES, METRES, METRES)


def level(
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> State:
    return (*position, *velocity, 1.0, 0.0, 0.0, 0.0, *rates, 0.0, 0.0, 0.0, 0.0)


def setpoint(**given: tuple[float, float, float]) -> tuple[float, ...]:
    zero = (0.0, 0.0, 0.0)
    names = ("position", "velocity", "acceleration", "jerk", "snap", "crackle")
    return tuple(x for name in names for x in given.get(name, zero))


def test_at_rest_on_the_setpoint_thrust_is_weight_torque_is_0():
    assert control(level(), setpoint(), GAINS, CALM) == (9.81, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("target", "signs"),
    [((1, 0, 0), (0, 1)), ((0, 1, 0), (-1, 0))],
    ids=["ahead: nose down", "to the left: left side down"],
)
def test_the_vehicle_tilts_towards_the_setpoint(target, signs):
    _, tx, ty, tz = control(level(), setpoint(position=target), GAINS, CALM)
    assert [(t > 1e-9) - (t < -1e-9) for t in (tx, ty)] == list(signs)
    assert abs(tz) < 1e-9


def test_a_setpoint_above_increases_the_thrust():
    assert control(level(), setpoint(position=(0.0, 0.0, 0.1)), GAINS, CALM)[0] == pytest.approx(
        9.81 + 0.64
    )


def test_body_rates_are_damped():
    _, *torques = control(level(rates=(1.0, 1.0, 1.0)), setpoint(), GAINS, CALM)
    inertia = PARAMS.vehicle.inertia
    # The thrust's direction turns with two rates at once; then come Euler's equations.
    gyroscopic = (
        inertia.x + inertia.z - inertia.y, inertia.x - inertia.z - inertia.y, 0.0,
    )  # fmt: skip
    damping = [-28.0 * j for j in (inertia.x, inertia.y, inertia.z)]
    assert torques == pytest.approx([d + g for d, g in zip(damping, gyroscopic, strict=True)])


def test_yaw_is_turned_back_to_zero():
    yawed = (*level()[:6], cos(0.2), 0.0, 0.0, sin(0.2), *level()[10:])
    assert control(yawed, setpoint(), GAINS, CALM)[3] == pytest.approx(
        -28.0 * 9.0 * 0.0069 * sin(0.4)
    )


def test_jerk_and_snap_are_fed_forward():
    inertia = PARAMS.vehicle.inertia
    # As small as here, the rates of the thrust's direction do not depend on each other.
    small = (0.0981, -0.1962, 0.0)
    _, tx, ty, _ = control(level(), setpoint(jerk=small), GAINS, CALM)
    assert (tx, ty) == pytest.approx((0.02 * 28.0 * inertia.x, 0.01 * 28.0 * inertia.y), rel=1e-4)
    _, tx, ty, _ = control(level(), setpoint(snap=small), GAINS, CALM)
    assert (tx, ty) == pytest.approx((0.02 * inertia.x, 0.01 * inertia.y))
    _, tx, ty, _ = control(level(), setpoint(crackle=small), GAINS, CALM)
    assert (tx, ty) == pytest.approx((0.02 * 0.022 * inertia.x, 0.01 * 0.022 * inertia.y))


def test_drag_is_compensated():
    fast = (4.0, 0.0, 0.0)
    force = specific_force(level(velocity=fast), setpoint(velocity=fast), GAINS, CALM)
    assert force == pytest.approx((1.6, 0.0, 9.81, 1.0))


@given(VECTOR, VECTOR, VECTOR)
def test_the_commanded_tilt_keeps_its_limit(position, velocity, acceleration):
    wanted = setpoint(position=position, velocity=velocity, acceleration=acceleration)
    fx, fy, fz, _ = specific_force(level(), wanted, GAINS, CALM)
    assert fz >= 0.2 * 9.81
    assert atan2((fx * fx + fy * fy) ** 0.5, fz) <= 0.7 + 1e-9


def test_a_distant_setpoint_asks_for_no_more_than_the_speed_limit():
    far = specific_force(level(), setpoint(position=(0.0, 0.0, 1000.0)), GAINS, CALM)
    assert far == pytest.approx((0.0, 0.0, 9.81 + 4.0 * 5.0, 1.0))


def test_without_gravity_the_thrust_direction_is_defined():
    gains = control_constants(DynamicsParams(vehicle=VehicleParams(gravity=0.0)))
    assert all(abs(x) < 1e-6 for x in control(level(), setpoint(), gains, CALM))


def test_a_clamped_tilt_disables_feed_forward():
    away = setpoint(position=(100.0, 0.0, 0.0), jerk=(40.0, 0.0, 0.0))
    still = setpoint(position=(100.0, 0.0, 0.0))
    assert specific_force(level(), away, GAINS, CALM)[3] == 0.0
    assert control(level(), away, GAINS, CALM)[1:] == control(level(), still, GAINS, CALM)[1:]
