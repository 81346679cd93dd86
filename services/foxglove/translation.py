"""Goals, parameters and messages as Foxglove has them. Pure."""

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from quadctl.schemas.earth import WORLD
from quadctl.schemas.services import GotoRequest
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid

_GOAL_HINT = 'publish {"x": 1, "y": 2, "z": 1.5}, m, or a PoseStamped or PointStamped of ROS'
_WORLD_BEFORE = "world"
"""Name of that frame until 2026, in layouts that users have saved."""
_FLOATS = (float, int)
_BAD = (msgspec.MsgspecError, TypeError, ValueError, OverflowError, RecursionError)


def goal_of(data: bytes, height: float | None) -> GotoRequest:
    """Return the request to fly to a published goal, in place of the present one; raise Invalid.

    Tools of viewers point at the ground: a goal of ROS of height 0 means `height` (m), if that is
    known yet.
    """
    try:
        plain = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Invalid(f"the goal is not JSON: {error}", _GOAL_HINT) from error
    place, of_ros = plain, False
    frame = _frame_of(plain)
    if frame not in {"", WORLD, _WORLD_BEFORE}:
        raise Invalid(f"the goal is in the frame {frame}", f"use {WORLD}")
    for name in ("pose", "position", "point"):
        if isinstance(place, dict) and name in place:
            place, of_ros = place[name], True
    if not isinstance(place, dict):
        raise Invalid("the goal is not a point", _GOAL_HINT)
    if not all(_is_finite(place.get(axis)) for axis in "xyz"):
        raise Invalid("the goal needs x, y and z, three finite numbers", _GOAL_HINT)
    x, y, z = (float(place[axis]) for axis in "xyz")
    if of_ros and not z:
        if height is None:
            raise Invalid(
                "a goal on the ground, and the present height is not known yet", "try again"
            )
        z = height
    return GotoRequest(x, y, z, replace=True)


def _frame_of(plain: Any) -> Any:
    """Return the frame that a message of ROS names, else an empty text."""
    header = plain.get("header") if isinstance(plain, dict) else None
    return header.get("frame_id", "") if isinstance(header, dict) else ""


def _is_finite(number: Any) -> bool:
    return isinstance(number, _FLOATS) and not isinstance(number, bool) and math.isfinite(number)


def readable(payload: bytes, encoding: str) -> bytes:
    """Return a message that is no JSON object as one that has it as `data`; bytes become hex."""
    try:
        return msgspec.json.encode({"data": codec.to_jsonable(payload, encoding)})
    except _BAD:
        return msgspec.json.encode({"data": payload.hex()})


def to_ours(given: Any, present: Any) -> Any:
    """Return a value of Foxglove as one of ours: a page writes the float 2.0 as 2."""
    if isinstance(present, float) and isinstance(given, int) and not isinstance(given, bool):
        return float(given)
    if isinstance(present, list) and isinstance(given, list):
        return [to_ours(each, next(iter(present), None)) for each in given]
    if isinstance(present, dict) and isinstance(given, dict):
        return {name: to_ours(each, present.get(name)) for name, each in given.items()}
    return given


def by_node(changes: Mapping[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """Group values named `uav.safety.takeoff` by vehicle and node, without the vehicle's name."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for name, value in changes.items():
        vehicle, _, own = name.partition(".")
        found.setdefault((vehicle, own.partition(".")[0]), {})[own] = value
    return found
