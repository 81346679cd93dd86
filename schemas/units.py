"""Bounded number types of the wire, and the description of a parameter.

The bounds refuse NaN and infinity too, because a comparison with NaN is always false. Metres end at
10 km: nothing in a lab is further away, and squares stay far from overflow.
"""

from typing import Annotated, Any

from msgspec import Meta

Metres = Annotated[float, Meta(ge=-10_000, le=10_000)]
MetresPerSecond = Annotated[float, Meta(ge=-1_000, le=1_000)]
RadiansPerSecond = Annotated[float, Meta(ge=-1_000, le=1_000)]
Unit = Annotated[float, Meta(ge=-1.000001, le=1.000001)]
"""Component of a unit quaternion, with room for rounding."""
Hectopascals = Annotated[float, Meta(ge=-2_000, le=2_000)]
"""Signed: after calibration the pressure topic carries a difference."""
Spread = Annotated[float, Meta(ge=0, le=2_000)]
Seconds = Annotated[float, Meta(ge=0, le=1e9)]
Clearance = Annotated[float, Meta(ge=-100_000, le=100_000)]
"""Distance (m) from a wall, negative beyond it."""
Count = Annotated[int, Meta(ge=0, le=2**53)]
"""Up to the last integer that a double counts exactly, so that JSON readers agree."""
Text = Annotated[str, Meta(max_length=1_000)]
Boot = Annotated[str, Meta(max_length=64)]


def described(description: str, unit: str = "", **bounds: Any) -> Meta:
    """Return a parameter's description, unit and bounds (`ge`, `gt`, `le`, `lt`)."""
    return Meta(description=description, extra={"unit": unit}, **bounds)
