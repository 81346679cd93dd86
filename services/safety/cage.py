"""The virtual cage: closed intervals x in [-cx, cx], y in [-cy, cy], z in [0, cz], metres."""

from math import sqrt

from schemas.messages import CageSize, Position

Interval = tuple[float, float]


def bounds(cage: CageSize) -> dict[str, Interval]:
    """The interval of each axis, m."""
    return {"x": (-cage.x, cage.x), "y": (-cage.y, cage.y), "z": (0.0, cage.z)}


def why_outside(point: Position, cage: CageSize) -> str:
    """Which axis leaves the cage and by which bound; empty when the point is inside.

    A point on the boundary is inside. Written so that NaN would be outside.
    """
    for axis, (low, high) in bounds(cage).items():
        value = getattr(point, axis)
        if not low <= value <= high:
            # Rounded as people say it, unless that would read as inside.
            rounded = float(f"{value:g}")
            said = value if low <= rounded <= high else rounded
            return f"outside the cage: {axis} = {_plain(said)} is beyond [{low:g}, {high:g}]"
    return ""


def beyond(point: Position, cage: CageSize) -> float:
    """How far from the cage a point lies, m; 0 inside."""
    x, y, z = excess(point, cage)
    return sqrt(x * x + y * y + z * z)


def excess(point: Position, cage: CageSize) -> tuple[float, float, float]:
    """How far a point lies beyond the nearest wall on each axis, m, signed; 0 between them."""
    return (
        _past(point.x, -cage.x, cage.x),
        _past(point.y, -cage.y, cage.y),
        _past(point.z, 0.0, cage.z),
    )


def _past(value: float, low: float, high: float) -> float:
    # NaN is in no interval, and comes out as it is.
    return 0.0 if low <= value <= high else value - (high if value > high else low)


def why_below(point: Position) -> str:
    """That the point lies below the floor, cage or no cage; empty when it does not."""
    return f"below the floor: z = {_plain(point.z)} is less than 0" if point.z < 0 else ""


def _plain(value: float) -> str:
    """All digits, so that a value one rounding beyond a bound does not read as the bound."""
    return repr(value).removesuffix(".0")
