"""Waits for an arrival by default: on the clock, and in simulated time as long as it goes on."""

import time
from typing import Any

import pytest

import quadctl
from quadctl import vehicle
from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Velocity,
)
from quadctl.schemas.services import GetParamsResponse, GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO

SLACK, PACE, FLIGHT = 0.2, 0.2, 0.15
"""Seconds of slack; simulated seconds in a second of the clock, and those of the flight."""
LIMITS = {
    f"dynamics.control.max_{name}": value
    for name, value in (("speed", 1e3), ("acceleration", 1e6), ("jerk", 1e9))
}


class Simulation:
    """Client of a vehicle that flies to its goal at a pace, or stands still for good."""

    timeout, vehicle, session = 0.5, "uav", None

    def __init__(self, pace: float) -> None:
        self._pace, self._began, self._number = pace, time.monotonic(), 0
        self.unread: dict[str, Any] = {}

    def subscribe(self, *_topics: Any) -> "Simulation":
        return self

    def close(self) -> None:
        """Do nothing: there is no bus."""

    def endpoints(self, *_kinds: Any) -> list[Any]:
        return []

    def call(self, service: Any, _request: Any, _timeout: Any = None) -> Any:
        return GotoResponse(True, "") if service is GOTO else GetParamsResponse(LIMITS, {})

    def next(self, timeout: float) -> Pose | SafetyState | None:
        if timeout <= 0:
            return None
        time.sleep(0.01)  # as a vehicle that publishes at 100 Hz
        stamp, self._number = (time.monotonic() - self._began) * self._pace, self._number + 1
        goal = Position(1.0, 0.0, 1.0)
        if self._number % 2:
            place = goal if stamp > FLIGHT else Position(0.0, 0.0, 1.0)
            still = (
                Velocity(0.0, 0.0, 0.0),
                Quaternion(1.0, 0.0, 0.0, 0.0),
                BodyRates(0.0, 0.0, 0.0),
            )
            return Pose("b", self._number, stamp, place, *still)
        state: Any = "HOVERING" if stamp > FLIGHT else "MOVING"
        return SafetyState("b", stamp, 1, state, goal, True, CageSize(5.0, 5.0, 5.0), "")


def flight(pace: float) -> vehicle.Flight:
    client: Any = Simulation(pace)
    return vehicle.Flight(client, GotoRequest(1.0, 0.0, 1.0))


def test_an_arrival_in_a_simulation_slower_than_the_clock_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(vehicle, "_SLACK", SLACK)
    assert flight(PACE).wait().seconds == pytest.approx(FLIGHT, abs=0.1)


def test_one_in_a_simulation_that_stands_still_is_not(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(vehicle, "_SLACK", SLACK)
    with pytest.raises(quadctl.TimedOut, match=r"not there after 0.2 s: 1.00 m to go"):
        flight(0.0).wait()
