"""Flights that we and a peer fly alike, open loop. Standard library only: peers import it too."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import sin, sqrt

RECORD = 0.1
"""Time (s) between compared states."""
COMMAND = 0.01
"""Time (s) for which a command is held."""

Motors = tuple[float, float, float, float]

_VEHICLE = {
    "mass": 1.0, "inertia_x": 0.0049, "inertia_y": 0.0050, "inertia_z": 0.0069, "arm": 0.08,
    "thrust": 1.91e-6, "torque": 2.6e-7, "most_speed": 2200.0, "lag": 0.02, "gravity": 9.81,
    "drag": 0.1, "across": 0.0, "along": 0.0,
}  # fmt: skip


@dataclass(frozen=True)
class Flight:
    """Vehicle, air and motor commands; SI units, frames as in rigidbody.py."""

    metres: float
    """Largest permitted difference (m) of positions."""
    attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    rates: tuple[float, float, float] = (0.1, -0.2, 0.3)
    velocity: tuple[float, float, float] = (0.5, 0.0, 0.0)
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turns: bool = True
    """True if the motors differ."""
    seconds: float = 2.0
    height: float = 1000.0
    """Height (m) of the start: high, because a floor would change a flight silently."""
    vehicle: Mapping[str, float] = field(default_factory=lambda: dict(_VEHICLE))

    @property
    def hover(self) -> float:
        """Return the motor speed (rad/s) that carries the weight."""
        return sqrt(self.vehicle["mass"] * self.vehicle["gravity"] / 4 / self.vehicle["thrust"])

    def command(self, number: int) -> Motors:
        """Return the commanded motor speeds (rad/s) of one COMMAND, in our order of rotors."""
        t = number * COMMAND
        waves = ((0.03, 7, 0), (0.03, 9, 1), (0.025, 8, 2), (0.03, 6, 3))
        if not self.turns:
            waves = (waves[0],) * 4
        a, b, c, d = (self.hover * (1.04 + k * sin(w * t + phase)) for k, w, phase in waves)
        return a, b, c, d


FLIGHTS = {
    "rotorpy": Flight(2e-9, wind=(2.0, -1.0, 0.5)),
    # Rotorpy uses the airspeed of each rotor, we use the centre's: equal without rotation.
    "rotorpy_rotor_drag": Flight(
        2e-9,
        attitude=(0.9, 0.3, -0.3, 0.1),
        rates=(0.0, 0.0, 0.0),
        wind=(2.0, -1.0, 0.5),
        turns=False,
        vehicle=_VEHICLE | {"across": 8e-5, "along": 5e-5},
    ),
    "mujoco": Flight(1e-10, vehicle=_VEHICLE | {"lag": 0.0, "drag": 0.0}),
}
"""Flights by the name of their recording, which begins with the name of the peer."""


def peer(name: str) -> str:
    """Return the peer of a recording."""
    return name.partition("_")[0]


def digest(flight: Flight) -> str:
    """Return sixteen digits that change with every number of a flight except its tolerance."""
    numbers = {name: value for name, value in asdict(flight).items() if name != "metres"}
    return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()[:16]


def start(flight: Flight) -> tuple[float, ...]:
    """Return position, velocity, attitude at unit length, and body rates."""
    length = sqrt(sum(q * q for q in flight.attitude))
    attitude = (q / length for q in flight.attitude)
    return (0.0, 0.0, flight.height, *flight.velocity, *attitude, *flight.rates)
