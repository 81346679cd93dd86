"""The air: U.S. Standard Atmosphere, 1976."""

_SEA_LEVEL = 1013.25
"""Pressure at height 0, hPa."""
_TEMPERATURE = 288.15
"""Temperature at height 0, K."""
_LAPSE = 0.0065
"""Loss of temperature with height, K/m."""
_EXPONENT = 5.255876
"""g M / (R L), a pure number."""


def pressure_at(height: float) -> float:
    """Static pressure (hPa) at a geometric height (m) in the troposphere, up to 11 km.

    p = 1013.25 (1 - 0.0065 h / 288.15)^5.255876: U.S. Standard Atmosphere 1976, eq. 33a.
    """
    return float(_SEA_LEVEL * (1 - _LAPSE * height / _TEMPERATURE) ** _EXPONENT)
