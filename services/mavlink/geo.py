"""Places on the earth and in our world, which is flat around its origin. Pure.

Degrees are those of WGS 84, in units of 1e-7 as in MAVLink; heights are above mean sea level. Within a
kilometre of the origin the flat earth is exact to a centimetre.
"""

from math import cos, radians, sin, sqrt

from msgspec import Struct

_RADIUS, _FLATTENING = 6_378_137.0, 1 / 298.257223563
_SQUARE = _FLATTENING * (2 - _FLATTENING)
"""Square of the ellipsoid's eccentricity."""
_UNITS = 1e7


class Origin(Struct, frozen=True):
    """Place of our world's origin: degrees, and m above mean sea level."""

    latitude: float
    longitude: float
    altitude: float

    def to_earth(self, x: float, y: float) -> tuple[int, int]:
        """Return latitude and longitude (1e-7 degrees) of a place, m, ENU."""
        north, east = self._metres_per_degree()
        return (
            round((self.latitude + y / north) * _UNITS),
            round((self.longitude + x / east) * _UNITS),
        )

    def to_world(self, latitude: int, longitude: int) -> tuple[float, float]:
        """Return the place (m, ENU) of latitude and longitude, 1e-7 degrees."""
        north, east = self._metres_per_degree()
        return (
            (longitude / _UNITS - self.longitude) * east,
            (latitude / _UNITS - self.latitude) * north,
        )

    def _metres_per_degree(self) -> tuple[float, float]:
        """Return the length of a degree to the north and to the east, from the radii of curvature."""
        phi = radians(self.latitude)
        part = 1 - _SQUARE * sin(phi) ** 2
        meridian = _RADIUS * (1 - _SQUARE) / (part * sqrt(part))
        return radians(meridian), radians(_RADIUS / sqrt(part) * cos(phi))
