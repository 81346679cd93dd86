"""Second implementation of the vehicle, with matrices and four explicit rotor positions.

It is solved by scipy's DOP853 at tolerances near rounding.
"""

from math import asin, dist, sqrt

import numpy as np
from scipy.integrate import solve_ivp

from quadctl.schemas.vehicle import VehicleParams

Array = np.ndarray


def skew(v: Array) -> Array:
    """Return the matrix of a cross product: skew(a) @ b is a x b."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(q: Array) -> Array:
    """Return the rotation from body to world of a quaternion w, x, y, z of any length.

    By the formula of Euler and Rodrigues.
    """
    cross = skew(q[1:])
    return np.eye(3) + 2.0 * (q[0] * cross + cross @ cross) / (q @ q)


class Reference:
    """Vehicle in steady wind, far above the floor."""

    def __init__(self, vehicle: VehicleParams, wind: tuple[float, float, float] = (0, 0, 0)):
        lever, ratio = vehicle.arm / sqrt(2.0), vehicle.torque_coefficient
        places = lever * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        up = np.array([0.0, 0.0, 1.0])
        senses = (1, -1, 1, -1)
        self._vehicle, self._wind, self._up = vehicle, np.array(wind), up
        # A column for each rotor: its torque per squared speed.
        self._torques = np.array(
            [
                vehicle.thrust_coefficient * np.cross(place, up) + sense * ratio * up
                for place, sense in zip(places, senses, strict=True)
            ]
        ).T
        self._inertia = np.diag([vehicle.inertia.x, vehicle.inertia.y, vehicle.inertia.z])
        self._inverse = np.linalg.inv(self._inertia)

    def rates(self, y: Array, motors: Array) -> Array:
        """Return the time derivative of position, velocity, quaternion and body rates."""
        vehicle, attitude, w, up = self._vehicle, rotation(y[6:10]), y[10:13], self._up
        relative = attitude.T @ (y[3:6] - self._wind)
        speed = sqrt(relative @ relative)
        along = (relative @ up) * up
        drag = (vehicle.linear_drag + vehicle.drag * speed) * relative + motors.sum() * (
            vehicle.rotor_drag.across * (relative - along) + vehicle.rotor_drag.along * along
        )
        squares = motors * motors
        force = vehicle.thrust_coefficient * squares.sum() * up - drag
        torque = self._torques @ squares
        spin = self._inverse @ (torque - skew(w) @ (self._inertia @ w))
        omega = np.zeros((4, 4))
        omega[0, 1:], omega[1:, 0], omega[1:, 1:] = -w, w, -skew(w)
        acceleration = attitude @ force / vehicle.mass - vehicle.gravity * up
        return np.concatenate([y[3:6], acceleration, 0.5 * omega @ y[6:10], spin])

    def fly(self, state: tuple[float, ...], command: tuple[float, ...], seconds: float) -> Array:
        """Return the 17 numbers of the state after some seconds with one command."""
        start, target = np.array(state[13:]), np.array(command)

        def motors(t: float) -> Array:
            return target + (start - target) * np.exp(-t / self._vehicle.motor_lag)

        solved = solve_ivp(
            lambda t, y: self.rates(y, motors(t)),
            (0.0, seconds),
            state[:13],
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
        )
        assert solved.success, solved.message
        return np.concatenate([solved.y[:, -1], motors(seconds)])


def angle(a: Array, b: Array) -> float:
    """Return the angle between two attitudes given as quaternions, rad."""
    a, b = np.asarray(a) / np.linalg.norm(a), np.asarray(b) / np.linalg.norm(b)
    chord = min(dist(a, b), dist(a, -b))
    return 4.0 * asin(min(1.0, 0.5 * chord))
