"""Messages as the console receives them, with default fields."""

from typing import Any

from msgspec.structs import replace

from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Pressure,
    Quaternion,
    SafetyState,
    Velocity,
)

_POSE = Pose(
    boot="a", seq=0, stamp=1.0, position=Position(0, 0, 1), velocity=Velocity(0, 0, 0),
    orientation=Quaternion(1, 0, 0, 0), body_rates=BodyRates(0, 0, 0),
)  # fmt: skip
_STATE = SafetyState(
    boot="a", stamp=1.0, request=1, state="HOVERING", goal=Position(0, 0, 1), cage_on=True,
    cage=CageSize(5, 5, 2), reason="",
)  # fmt: skip


def pose(x: float = 0, y: float = 0, z: float = 1, **more: Any) -> Pose:
    return replace(_POSE, position=Position(x, y, z), **more)


def state(**changed: Any) -> SafetyState:
    return replace(_STATE, **changed)


def reading(pressure: float, baseline: float = 0.0) -> Pressure:
    return Pressure(stamp=1.0, pressure=pressure, baseline=baseline, samples=0, spread=0)
