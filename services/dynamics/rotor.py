"""Mixing: collective thrust and body torques to four motor speed commands."""

from math import sqrt

from schemas.vehicle import VehicleParams
from services.dynamics.rigidbody import Motors

Mixer = tuple[float, ...]
"""4 floats made by `mixer_constants`."""


def mixer_constants(vehicle: VehicleParams) -> Mixer:
    """What `mix` needs of the parameters, in the order of use.

    The lever of a rotor about body x and y is arm / sqrt(2), because the arms stand at 45 degrees.
    """
    return (
        0.25 * sqrt(2.0) / vehicle.arm,
        0.25 * vehicle.thrust_coefficient / vehicle.torque_coefficient,
        vehicle.thrust_coefficient * vehicle.max_motor_speed**2,
        1.0 / vehicle.thrust_coefficient,
    )


def hover_speed(vehicle: VehicleParams) -> float:
    """Motor speed at which four rotors carry the weight, at most the limit, rad/s."""
    speed = sqrt(0.25 * vehicle.mass * vehicle.gravity / vehicle.thrust_coefficient)
    return min(speed, vehicle.max_motor_speed)


def mix(thrust: float, tx: float, ty: float, tz: float, mixer: Mixer) -> Motors:
    """Motor speeds (rad/s) for a thrust (N, along body z) and torques (N m, body frame).

    Where a rotor would pass its limits, roll and pitch are kept, thrust moves to make room for
    them and yaw gets what is left: a quadrotor that loses tilt falls, one that loses yaw turns.
    """
    per_lever, per_yaw, most, per_thrust = mixer
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
    f0 = base + roll - pitch + yaw
    f1 = base + roll + pitch - yaw
    f2 = base - roll + pitch + yaw
    f3 = base - roll - pitch - yaw
    # Rounding may leave a force a hair below zero, where there is no root.
    return (
        sqrt((f0 if f0 > 0.0 else 0.0) * per_thrust),
        sqrt((f1 if f1 > 0.0 else 0.0) * per_thrust),
        sqrt((f2 if f2 > 0.0 else 0.0) * per_thrust),
        sqrt((f3 if f3 > 0.0 else 0.0) * per_thrust),
    )
