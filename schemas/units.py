"""Bounded number types: the one place that says how far a value on the wire may go.

The bounds refuse NaN and infinity too, because a comparison with NaN never holds.
Metres end at 10 km: nothing in a lab is further away, and squares stay far from overflow.
"""

from typing import Annotated

from msgspec import Meta

Metres = Annotated[float, Meta(ge=-10_000, le=10_000)]
MetresPerSecond = Annotated[float, Meta(ge=-1_000, le=1_000)]
RadiansPerSecond = Annotated[float, Meta(ge=-1_000, le=1_000)]
Unit = Annotated[float, Meta(ge=-1.000001, le=1.000001)]
"""A component of a unit quaternion, with room for rounding."""
Hectopascals = Annotated[float, Meta(ge=-2_000, le=2_000)]
"""Signed: after calibration the pressure topic shows a difference."""
Spread = Annotated[float, Meta(ge=0, le=2_000)]
Seconds = Annotated[float, Meta(ge=0, le=1e9)]
Count = Annotated[int, Meta(ge=0, le=2**53)]
"""Ends where a double stops counting exactly, so that JSON readers agree."""
Text = Annotated[str, Meta(max_length=1_000)]
Boot = Annotated[str, Meta(max_length=64)]
