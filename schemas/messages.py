"""Messages of the topics, and the vectors in them."""

from typing import Any, Literal, Self

from msgspec import Struct, structs

from quadctl.schemas.units import (
    Boot,
    Clearance,
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
from quadctl.schemas.zones import CircleParams, ZoneKind, ZoneParams


class Position(Struct, frozen=True, forbid_unknown_fields=True):
    """Point in the world, m, ENU."""

    x: Metres
    y: Metres
    z: Metres


class Velocity(Struct, frozen=True, forbid_unknown_fields=True):
    """Velocity in the world frame, m/s, ENU."""

    x: MetresPerSecond
    y: MetresPerSecond
    z: MetresPerSecond


class BodyRates(Struct, frozen=True, forbid_unknown_fields=True):
    """Angular velocity in the body frame, rad/s, FLU."""

    x: RadiansPerSecond
    y: RadiansPerSecond
    z: RadiansPerSecond


class Quaternion(Struct, frozen=True, forbid_unknown_fields=True):
    """Rotation from body to world; unit length."""

    w: Unit
    x: Unit
    y: Unit
    z: Unit


StateName = Literal["HOVERING", "VERIFYING", "MOVING"]


class Pose(Struct, frozen=True):
    """True pose of the vehicle.

    `boot` names the simulation's boot and `seq` counts its poses from 0; `stamp` is simulated time,
    s. Position and velocity are ENU, the orientation is from body (FLU) to world, the body rates
    are in the body frame.
    """

    boot: Boot
    seq: Count
    stamp: Seconds
    position: Position
    velocity: Velocity
    orientation: Quaternion
    body_rates: BodyRates


class Poses(Struct, frozen=True):
    """Poses that go out together, the oldest first."""

    poses: list[Pose]


class Waypoint(Struct, frozen=True, forbid_unknown_fields=True):
    """Request to fly to this point, m, ENU: the lab's fire-and-forget command."""

    x: Metres
    y: Metres
    z: Metres


class Setpoint(Struct, frozen=True):
    """Present command of safety to the vehicle.

    Fly to `position` (m, ENU), or, with `brake`, come to rest at the vehicle's own stopping point.
    `for_seq` is the pose that it answers; the vehicle ignores a setpoint of another `boot`.
    """

    boot: Boot
    for_seq: Count
    position: Position
    brake: bool


class Pressure(Struct, frozen=True):
    """Reading of the barometer: hPa, minus the baseline.

    `stamp` is simulated time, s; for a real sensor without a simulation, seconds since its start.
    `samples` and `spread` (largest minus smallest, hPa) show the quality of the baseline; all three
    are 0 while the sensor is not zeroed.
    """

    stamp: Seconds
    pressure: Hectopascals
    baseline: Hectopascals
    samples: Count
    spread: Spread


class CageSize(Struct, frozen=True):
    """Virtual cage: x in [-x, x], y in [-y, y], z in [0, z], m, closed intervals."""

    x: Metres
    y: Metres
    z: Metres


class NearestWall(Struct, frozen=True):
    """Wall nearest to the vehicle: `cage` or a zone's name, and its distance (m), negative beyond it.

    `near` is true within the parameter `safety.warn_within`. Without a name there is none.
    """

    name: Text = ""
    distance: Clearance = 0.0
    near: bool = False


class ZoneCorner(Struct, frozen=True):
    """Corner of a zone, m: viewers read no lists within lists."""

    x: Metres
    y: Metres


class Zone(Struct, frozen=True):
    """Column over corners, or over a circle if there are none; see ZoneParams."""

    name: Text
    kind: ZoneKind
    corners: tuple[ZoneCorner, ...]
    circle: CircleParams
    floor: Metres
    ceiling: Metres

    @classmethod
    def of(cls, params: ZoneParams) -> Self:
        """Return the message of a zone's parameters."""
        corners = tuple(ZoneCorner(*corner) for corner in params.polygon)
        return cls(params.name, params.kind, corners, params.circle, params.floor, params.ceiling)

    @property
    def polygon(self) -> tuple[tuple[Metres, Metres], ...]:
        """Return the corners as pairs, m."""
        return tuple((corner.x, corner.y) for corner in self.corners)

    @property
    def params(self) -> ZoneParams:
        """Return the zone as its parameters."""
        return ZoneParams(self.name, self.kind, self.polygon, self.circle, self.floor, self.ceiling)


class Zones(Struct, frozen=True):
    """Zones in force while the cage is on."""

    zones: tuple[Zone, ...]


PAUSED = "paused: "
"""Prefix of `reason` while a paused flight hovers, which resumes when poses come again."""
WAITS = "waits: "
"""Prefix of `reason` while a goal waits for other vehicles, which the vehicle then flies to."""


class SafetyState(Struct, frozen=True):
    """State of the automaton.

    `request` counts the requested waypoints, so that two equal refusals differ. `goal` is the point
    that the vehicle flies to or holds, m. `reason` explains why the last request was refused, or
    why the flight stopped, paused or went on, and is empty otherwise. `stamp` is simulated time, s.
    On a way around zones the vehicle flies `leg` of `legs`, else both are 0. `nearest` has no name
    while the cage is off.
    """

    boot: Boot
    stamp: Seconds
    request: Count
    state: StateName
    goal: Position
    cage_on: bool
    cage: CageSize
    reason: Text
    leg: Count = 0
    legs: Count = 0
    nearest: NearestWall = NearestWall()


def without_wording(state: SafetyState) -> tuple[Any, ...]:
    """Return the fields that a flight's hash covers; of the reason only (given, a pause).

    The wording of a reason may change from one version to the next, a verdict may not. Legs count
    where there are any; the nearest wall follows from the pose.
    """
    reason = (state.reason != "", state.reason.startswith(PAUSED))
    fields = structs.asdict(state) | {"reason": reason}
    leg, legs, _ = (fields.pop(name) for name in ("leg", "legs", "nearest"))
    return (*fields.values(), *((leg, legs) if legs else ()))


class Info(Struct, frozen=True):
    """Nodes by service name, and nodes by topic name."""

    vehicle: Text
    services: dict[str, str]
    topics: dict[str, str]


class Called(Struct, frozen=True):
    """Call that a node has executed: its service, request and result.

    `boot` and `stamp` (s) are the simulated time that the node had reached; `held` means that the
    call was made ahead, for that time. A refused call has an `error` and an empty `response`.
    """

    boot: Boot
    stamp: Seconds
    service: Text
    held: bool
    request: dict[str, Any]
    response: dict[str, Any]
    error: Text
