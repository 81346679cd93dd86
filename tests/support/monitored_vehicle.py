"""The real vehicle model in step with the real monitor, without a bus."""

import math
import random
from collections.abc import Callable
from functools import cache

from msgspec.structs import replace

from quadctl.schemas.messages import Position, Velocity
from quadctl.schemas.params import DynamicsParams, SafetyParams, StartParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace import airworthiness
from quadctl.services.dynamics.compiler import load
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.safety.model import State
from quadctl.services.safety.monitor import Monitor
from quadctl.services.safety.traffic import Traffic
from tests.support.compiled import compiled_vehicle
from tests.support.worlds import POSE

model = cache(lambda: load(compiled_vehicle()))
LOOKS = 5
"""Looks at the vehicle in a period of the setpoint, 10 ms each."""
_LOOK_MS = round(1000 / SETPOINT.hz) // LOOKS


class MonitoredVehicle:
    """Vehicle that hovers at its start; alone, or of some traffic."""

    def __init__(
        self,
        params: SafetyParams,
        start: Position,
        name: str = "uav",
        traffic: Traffic | None = None,
        body: DynamicsParams | None = None,
    ) -> None:
        self.monitor = Monitor(
            params, lambda *_: None, restarted=False, grace=1.0, name=name, traffic=traffic
        )
        dynamics = replace(body or DynamicsParams(), start=StartParams(start.x, start.y, start.z))
        flies = dynamics.vehicle, dynamics.control, dynamics.wind
        self.law = airworthiness.stopping_law(*flies)
        self.monitor.set_vehicle(*flies)
        self.vehicle = Vehicle(dynamics)
        self.vehicle.fly = model()
        self._sent: object = None

    @property
    def place(self) -> Position:
        return Position(*self.vehicle.position)

    @property
    def is_done(self) -> bool:
        """Return whether the vehicle stands still, at its goal or where it stopped."""
        s = self.monitor.situation
        speed = math.hypot(*self.vehicle.velocity)
        waits = self.monitor.held is not None
        return s.state is State.HOVERING and not s.stops and speed < 1e-3 and not waits

    def see(self) -> None:
        """Show the vehicle's pose to its monitor."""
        stamp = self.vehicle.time
        self.monitor.see(
            replace(POSE, stamp=stamp, seq=round(1000 * stamp), position=self.place,
                    velocity=Velocity(*self.vehicle.velocity))
        )  # fmt: skip

    def obey(self) -> None:
        """Send the monitor's setpoint to the vehicle."""
        setpoint = self.monitor.setpoint()
        if (command := (setpoint.position, setpoint.brake)) != self._sent:
            self._sent = command
            p = setpoint.position
            self.vehicle.brake() if setpoint.brake else self.vehicle.goto(p.x, p.y, p.z)

    def advance(self) -> None:
        """Fly on until the next look."""
        self.vehicle.advance(_LOOK_MS)


def random_height(draws: random.Random, most: float) -> float:
    """Return a height (m); many are near the floor, where ways bend."""
    return draws.uniform(0.0, 0.2 if draws.random() < 0.3 else most)


def periods(seconds: float) -> range:
    """Return the periods of the setpoint in a time (s)."""
    return range(round(seconds * SETPOINT.hz))


def land(fly_on: Callable[[], None], is_done: Callable[[], bool], longest: float = 600.0) -> None:
    """Fly, period by period, until everything stands still."""
    for _ in periods(longest):
        fly_on()
        if is_done():
            return
    raise AssertionError("the flight does not end")
