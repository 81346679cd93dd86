"""Vectors on the wire. World frame ENU, body frame FLU."""

from msgspec import Struct

from schemas.units import Metres, MetresPerSecond, RadiansPerSecond, Unit


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
