"""Setpoint without a vehicle, advanced step by step."""

from math import ceil, inf

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics import flight_modes, trajectory
from quadctl.services.dynamics.controller import PERIOD, Setpoint
from quadctl.services.dynamics.trajectory import Axis, limits_of


class Path:
    """Setpoint of one vehicle, one control period at a time."""

    def __init__(self, params: DynamicsParams, position: tuple[float, float, float]) -> None:
        self._limits = limits_of(params)
        self._plan = trajectory.resting(*position, self._limits)
        self._mode = flight_modes.fresh(standing=False)

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
        self._plan, self._mode = flight_modes.goto(
            self._plan, self._mode, x, y, z, 0.0, self._limits
        )

    def brake(self) -> None:
        self._plan, self._mode = flight_modes.brake(self._plan, self._mode, self._limits)

    def advance(self) -> None:
        self._plan, self._mode = flight_modes.next_leg(
            inf, self._plan, self._mode, 2.0, 0.0, self._limits
        )

    def advance_for(self, seconds: float) -> None:
        for _ in range(ceil(seconds / PERIOD)):
            self.advance()
