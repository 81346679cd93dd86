"""Mixer: collective thrust and body torques to four motor speed commands.

Straight-line code, as in rigidbody.py. SI units, body frame FLU.
"""

from math import exp, sqrt

from quadctl.schemas.vehicle import VehicleParams
from quadctl.services.dynamics.rigidbody import Motors, State

Mixer = tuple[float, ...]
"""6 floats made by `mixer_constants`."""


def mixer_constants(vehicle: VehicleParams, period: float) -> Mixer:
    """Return the parameters and the control period (s) that `mix` uses, in the order of use."""
    return (
        0.25 * sqrt(2.0) / vehicle.arm,  # the lever about x and y: arms at 45 degrees
        0.25 * vehicle.thrust_coefficient / vehicle.torque_coefficient,
        vehicle.thrust_coefficient * vehicle.max_motor_speed**2,
        1.0 / vehicle.thrust_coefficient,
        vehicle.max_motor_speed,
        exp(-period / vehicle.motor_lag),
    )


def hover_speed(vehicle: VehicleParams) -> float:
    """Return the motor speed (rad/s) at which four rotors carry the weight, at most the limit."""
    speed = sqrt(0.25 * vehicle.mass * vehicle.gravity / vehicle.thrust_coefficient)
    return min(speed, vehicle.max_motor_speed)


# fmt: off
def mix(
    thrust: float, tx: float, ty: float, tz: float, state: State, mixer: Mixer
) -> Motors:
    """Return motor speed commands (rad/s) for a thrust (N, along body z) and torques (N m).

    If a rotor would pass its limits, roll and pitch are kept, thrust moves to make room for them,
    and yaw gets the rest: a quadrotor that loses tilt falls, but one that loses yaw only turns.

    Each command takes the rotor's thrust, not its speed, through one period of a first-order lag.
    Thrust goes with the square of the speed: if the speeds lagged freely, the four together would
    lose lift whenever they differ.
    """
    _, _, _, _, _, _, _, _, _, _, _, _, _, m0, m1, m2, m3 = state
    per_lever, per_yaw, most, per_thrust, fastest, decay = mixer
    roll = per_lever * tx
    pitch = per_lever * ty
    swing = abs(roll) + abs(pitch)
    half = 0.5 * most
    shrink = half / swing if swing > half else 1.0
    roll = roll * shrink
    pitch = pitch * shrink
    swing = swing * shrink
    base = 0.25 * thrust
    base = swing if base < swing else base
    base = most - swing if base > most - swing else base
    room = (base if base < half else most - base) - swing
    yaw = per_yaw * tz
    yaw = room if yaw > room else yaw
    yaw = -room if yaw < -room else yaw
    # Squared speeds at the end of the period.
    gain = (1.0 - decay) * per_thrust
    s0 = (base + roll - pitch + yaw) * gain + m0 * m0 * decay
    s1 = (base + roll + pitch - yaw) * gain + m1 * m1 * decay
    s2 = (base - roll + pitch + yaw) * gain + m2 * m2 * decay
    s3 = (base - roll - pitch - yaw) * gain + m3 * m3 * decay
    gain = 1.0 / (1.0 - decay)
    c0 = (sqrt(s0 if s0 > 0.0 else 0.0) - m0 * decay) * gain
    c1 = (sqrt(s1 if s1 > 0.0 else 0.0) - m1 * decay) * gain
    c2 = (sqrt(s2 if s2 > 0.0 else 0.0) - m2 * decay) * gain
    c3 = (sqrt(s3 if s3 > 0.0 else 0.0) - m3 * decay) * gain
    # Below 0 only by rounding: without thrust the square falls by `decay`, its root by less.
    c0 = c0 if c0 > 0.0 else 0.0
    c1 = c1 if c1 > 0.0 else 0.0
    c2 = c2 if c2 > 0.0 else 0.0
    c3 = c3 if c3 > 0.0 else 0.0
    return (
        c0 if c0 < fastest else fastest,
        c1 if c1 < fastest else fastest,
        c2 if c2 < fastest else fastest,
        c3 if c3 < fastest else fastest,
    )
# fmt: on
