"""Rules for goals that other networks publish. Pure."""

from math import isfinite
from typing import Any

from quadctl.schemas.earth import WORLD
from quadctl.schemas.services import GotoRequest
from quadctl.services.runtime.errors import Invalid

_FRAMES = ("", WORLD, "world")
"""Frames of a goal; the last one is the name of that frame until 2026, which users may have saved."""
_MOST_SHOWN = 64
"""Characters of a foreign text in our log."""


def goal_of(
    frame: str, place: tuple[Any, Any, Any], height: float | None, *, grounded: bool
) -> GotoRequest:
    """Return the request to fly to a place (m), in place of the present goal; raise Invalid.

    Tools of viewers point at the ground: with `grounded`, a goal of height 0 means `height` (m), if
    that is known yet.
    """
    if frame not in _FRAMES:
        raise Invalid(f"the goal is in the frame {frame[:_MOST_SHOWN]}", f"use {WORLD}")
    if not all(map(_is_finite, place)):
        raise Invalid("the goal needs x, y and z, three finite numbers", "publish them, in m")
    x, y, z = map(float, place)
    if grounded and not z:
        if height is None:
            raise Invalid(
                "a goal on the ground, and the present height is not known yet", "try again"
            )
        z = height
    return GotoRequest(x, y, z, replace=True)


def _is_finite(number: Any) -> bool:
    return isinstance(number, float | int) and not isinstance(number, bool) and isfinite(number)
