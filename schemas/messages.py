"""Messages of the topics, and the vectors in them."""

from typing import Any, Literal

from msgspec import Struct, structs

from quadctl.schemas.units import (
    Boot,
    Count,
    Hectopascals,
    Metres,
    MetresPerSecond,
    RadiansPerSecond,
    Seconds,
    Spread,
    Text,
    Unit,
)


class Position(Struct, frozen=True, forbid_unknown_fields=True):
    """A point in the world, m, ENU."""

    x: Metres
    y: Metres
    z: Metres


class Velocity(Struct, frozen=True, forbid_unknown_fields=True):
    """A velocity in the world frame, m/s, ENU."""

    x: MetresPerSecond
    y: MetresPerSecond
    z: MetresPerSecond


class BodyRates(Struct, frozen=True, forbid_unknown_fields=True):
    """Angular velocity in the body frame, rad/s, FLU."""

    x: RadiansPerSecond
    y: RadiansPerSecond
    z: RadiansPerSecond


class Quaternion(Struct, frozen=True, forbid_unknown_fields=True):
    """A rotation from body to world; unit length."""

    w: Unit
    x: Unit
    y: Unit
    z: Unit


StateName = Literal["HOVERING", "VERIFYING", "MOVING"]


class Pose(Struct, frozen=True):
    """Where the vehicle truly is.

    `boot` names the simulation's boot and `seq` counts its poses from 0; `stamp` is simulated
    time, s. Position and velocity are ENU, the orientation turns body (FLU) into world, the
    body rates are in the body frame.
    """

    boot: Boot
    seq: Count
    stamp: Seconds
    position: Position
    velocity: Velocity
    orientation: Quaternion
    body_rates: BodyRates


class Waypoint(Struct, frozen=True, forbid_unknown_fields=True):
    """The lab's fire-and-forget command: fly to this point, m, ENU."""

    x: Metres
    y: Metres
    z: Metres


class Setpoint(Struct, frozen=True):
    """What safety wants of the vehicle now.

    Fly to `position` (m, ENU), or, with `brake`, come to rest at the vehicle's own stopping
    point. `for_seq` is the pose it answers; a setpoint of another `boot` is not followed.
    """

    boot: Boot
    for_seq: Count
    position: Position
    brake: bool


class Pressure(Struct, frozen=True):
    """The barometer's reading: hPa, the baseline already subtracted.

    `stamp` is simulated time, s; of a real sensor beside no simulation, seconds since its start.
    `samples` and `spread` (largest minus smallest, hPa) tell how good the baseline is; all three
    are 0 while the sensor is not zeroed.
    """

    stamp: Seconds
    pressure: Hectopascals
    baseline: Hectopascals
    samples: Count
    spread: Spread


class CageSize(Struct, frozen=True):
    """The virtual cage: x in [-x, x], y in [-y, y], z in [0, z], m, closed intervals."""

    x: Metres
    y: Metres
    z: Metres


PAUSED = "paused: "
"""What `reason` begins with while a flight hovers that goes on by itself when poses come again."""


class SafetyState(Struct, frozen=True):
    """The automaton as it is.

    `request` counts the waypoints asked for, so that two equal refusals differ. `goal` is where
    the vehicle is sent or holds, m. `reason` says why the last request was refused, or the flight
    stopped, paused or went on, and is empty otherwise. `stamp` is simulated time, s.
    """

    boot: Boot
    stamp: Seconds
    request: Count
    state: StateName
    goal: Position
    cage_on: bool
    cage: CageSize
    reason: Text


def without_wording(state: SafetyState) -> tuple[Any, ...]:
    """Return the fields that a flight's hash covers: all, the reason as (given, a pause) alone.

    A reason's wording may change from one version to the next, a verdict may not.
    """
    reason = (state.reason != "", state.reason.startswith(PAUSED))
    fields = structs.asdict(state) | {"reason": reason}
    return tuple(fields.values())


class Info(Struct, frozen=True):
    """Who serves what: service name to node, topic name to node."""

    vehicle: Text
    services: dict[str, str]
    topics: dict[str, str]


class Called(Struct, frozen=True):
    """A call that a node has executed: what was asked of which service, and what came of it.

    `boot` and `stamp` (s) are the simulated time that the node had come to; `held` says that the
    call was made ahead, for that time. Where it was refused `response` is empty, and `error` says
    why.
    """

    boot: Boot
    stamp: Seconds
    service: Text
    held: bool
    request: dict[str, Any]
    response: dict[str, Any]
    error: Text
