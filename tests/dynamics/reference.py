"""The same vehicle written a second time, with matrices and four rotors in their places, and solved
by scipy's DOP853 at tolerances near rounding."""

from math import asin, dist, sqrt

import numpy as np
from scipy.integrate import solve_ivp

from schemas.vehicle import VehicleParams

Array = np.ndarray


def rotation(q: Array) -> Array:
    """Body to world, of a quaternion w, x, y, z of any length: Euler and Rodrigues' formula."""
    w, *v = q
    x, y, z = v
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * (w * cross + cross @ cross) / (q @ q)


class Reference:
    """A vehicle in steady wind, far above the floor."""

    def __init__(self, vehicle: VehicleParams, wind: tuple[float, float, float] = (0, 0, 0)):
        lever = vehicle.arm / sqrt(2.0)
        self._vehicle, self._wind = vehicle, np.array(wind)
        self._places = lever * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        self._inertia = np.diag([vehicle.inertia.x, vehicle.inertia.y, vehicle.inertia.z])

    def rates(self, y: Array, motors: Array) -> Array:
        """Time derivative of position, velocity, quaternion and body rates."""
        vehicle, attitude, w = self._vehicle, rotation(y[6:10]), y[10:13]
        up = np.array([0.0, 0.0, 1.0])
        relative = attitude.T @ (y[3:6] - self._wind)
        force = -(vehicle.linear_drag + vehicle.drag * np.linalg.norm(relative)) * relative
        torque = np.zeros(3)
        for place, sense, speed in zip(self._places, (1, -1, 1, -1), motors, strict=True):
            thrust = vehicle.thrust_coefficient * speed**2 * up
            along = (relative @ up) * up
            force = force + thrust
            force = force - speed * vehicle.rotor_drag.across * (relative - along)
            force = force - speed * vehicle.rotor_drag.along * along
            torque = torque + np.cross(place, thrust)
            torque = torque + sense * vehicle.torque_coefficient * speed**2 * up
        spin = np.linalg.solve(self._inertia, torque - np.cross(w, self._inertia @ w))
        omega = np.array(
            [[0, -w[0], -w[1], -w[2]], [w[0], 0, w[2], -w[1]],
             [w[1], -w[2], 0, w[0]], [w[2], w[1], -w[0], 0]]
        )  # fmt: skip
        acceleration = attitude @ force / vehicle.mass - vehicle.gravity * up
        return np.concatenate([y[3:6], acceleration, 0.5 * omega @ y[6:10], spin])

    def fly(self, state: tuple[float, ...], command: tuple[float, ...], seconds: float) -> Array:
        """The 17 numbers of the state after a while with one command."""
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
            first_step=min(seconds, 0.004),  # its own first guess is far smaller, and costs
        )
        assert solved.success, solved.message
        return np.concatenate([solved.y[:, -1], motors(seconds)])


def angle(a: Array, b: Array) -> float:
    """Between two attitudes given as quaternions, rad."""
    a, b = np.asarray(a) / np.linalg.norm(a), np.asarray(b) / np.linalg.norm(b)
    chord = min(dist(a, b), dist(a, -b))
    return 4.0 * asin(min(1.0, 0.5 * chord))
