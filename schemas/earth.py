"""Places on the earth, and in our world, which is flat around its origin.

Degrees are those of WGS 84, in MAVLink's units of 1e-7, about a centimetre; heights are above mean
sea level. Within 100 m of the origin the flat earth is exact to that centimetre.
"""

from collections.abc import Sequence
from math import cos, radians, sin, sqrt
from typing import Annotated

from msgspec import Meta, Struct, ValidationError

from quadctl.schemas.typed import converted

WORLD = "map"
"""Name of our world's frame, for all tools, after ROS's convention (REP 105)."""
_RADIUS, _FLATTENING = 6_378_137.0, 1 / 298.257223563
_SQUARE = _FLATTENING * (2 - _FLATTENING)
"""Square of the ellipsoid's eccentricity."""
_UNITS = 1e7

Latitude = Annotated[float, Meta(ge=-89, le=89)]
"""Degrees; at a pole a flat earth has no east."""
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Altitude = Annotated[float, Meta(ge=-1_000, le=10_000)]


class Origin(Struct, frozen=True):
    """Place of our world's origin: degrees, and m above mean sea level; by default that of PX4's simulators."""

    latitude: Latitude = 47.397742
    longitude: Longitude = 8.545594
    altitude: Altitude = 488.0

    def to_earth(self, x: float, y: float) -> tuple[int, int]:
        """Return latitude and longitude (1e-7 degrees) of a place, m, ENU."""
        north, east = self._metres_per_degree()
        return (
            round((self.latitude + y / north) * _UNITS),
            round(_wrapped(self.longitude + x / east) * _UNITS),
        )

    def to_world(self, latitude: int, longitude: int) -> tuple[float, float]:
        """Return the place (m, ENU) of latitude and longitude, 1e-7 degrees."""
        north, east = self._metres_per_degree()
        return (
            _wrapped(longitude / _UNITS - self.longitude) * east,
            (latitude / _UNITS - self.latitude) * north,
        )

    def _metres_per_degree(self) -> tuple[float, float]:
        """Return the length of a degree to the north and to the east, from the radii of curvature."""
        phi = radians(self.latitude)
        part = 1 - _SQUARE * sin(phi) ** 2
        meridian = _RADIUS * (1 - _SQUARE) / (part * sqrt(part))
        return radians(meridian), radians(_RADIUS / sqrt(part) * cos(phi))


def origin_of(numbers: Sequence[float]) -> Origin:
    """Return the origin of latitude, longitude and height; raise ValueError for no place on earth."""
    given = dict(zip(Origin.__struct_fields__[: len(numbers)], numbers, strict=True))
    for name, number in given.items():
        try:
            converted({name: number}, Origin)
        except ValidationError as error:
            raise ValueError(f"{name} {number:g}") from error
    return Origin(**given)


def _wrapped(degrees: float) -> float:
    """Return a longitude, or a difference of two, from -180 to 180 degrees."""
    return (degrees + 180) % 360 - 180
