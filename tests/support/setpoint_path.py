"""Setpoint without a vehicle, advanced step by step."""

from math import ceil

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics import trajectory
from quadctl.services.dynamics.controller import PERIOD, Setpoint
from quadctl.services.dynamics.trajectory import Axis, limits_of


class Path:
    """Setpoint of one vehicle, one control period at a time."""

    def __init__(self, params: DynamicsParams, position: tuple[float, float, float]) -> None:
        self._limits = limits_of(params)
        self._plan = trajectory.resting(*position, self._limits)

    @property
    def setpoint(self) -> Setpoint:
        return trajectory.setpoint_of(self._plan, self._limits)

    @property
    def x(self) -> Axis:
        return self._plan[0]

    @property
    def goal(self) -> tuple[float, float, float]:
        x, y, z = (axis[3] for axis in self._plan[:3])
        return x, y, z

    @property
    def at_rest(self) -> bool:
        return trajectory.at_rest(self._plan, self._limits)

    def goto(self, x: float, y: float, z: float) -> None:
        self._plan = trajectory.goto(self._plan, x, y, z, self._limits)

    def brake(self) -> None:
        self._plan = trajectory.brake(self._plan, self._limits)

    def advance(self) -> None:
        self._plan = trajectory.advance(self._plan, self._limits)

    def advance_for(self, seconds: float) -> None:
        for _ in range(ceil(seconds / PERIOD)):
            self.advance()
