"""Virtual cage: a box that stands on the floor; its walls belong to it. m, ENU."""

from quadctl.schemas.messages import CageSize
from quadctl.schemas.params import CageParams
from quadctl.services.airspace.geometry import Point

Interval = tuple[float, float]
Cage = CageSize | CageParams


def bounds(cage: Cage) -> dict[str, Interval]:
    """Return the interval of each axis."""
    return {"x": (-cage.x, cage.x), "y": (-cage.y, cage.y), "z": (0.0, cage.z)}


def why_outside(point: Point, cage: Cage) -> str:
    """Return which axis leaves the cage by which bound; empty if the point is inside.

    A point on the boundary is inside. NaN is outside.
    """
    for value, (axis, (low, high)) in zip(point, bounds(cage).items(), strict=True):
        if not low <= value <= high:
            # Rounded for readers, unless the rounded value would be inside.
            rounded = float(f"{value:g}")
            shown = value if low <= rounded <= high else rounded
            return f"outside the cage: {axis} = {_plain(shown)} is beyond [{low:g}, {high:g}]"
    return ""


def why_below(point: Point) -> str:
    """Return the reason if the point is below the floor, cage or no cage; else an empty string."""
    return f"below the floor: z = {_plain(point[2])} is less than 0" if point[2] < 0 else ""


def _plain(value: float) -> str:
    """Return all digits, so that a value barely beyond a bound does not read as the bound."""
    return repr(value).removesuffix(".0")
