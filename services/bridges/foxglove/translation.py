"""Goals, parameters and messages as Foxglove has them. Pure."""

from collections.abc import Mapping
from typing import Any

import msgspec

from quadctl.schemas.services import GotoRequest
from quadctl.services.bridges.world import goal_of
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid

_GOAL_HINT = 'publish {"x": 1, "y": 2, "z": 1.5}, m, or a PoseStamped or PointStamped of ROS'
_BAD = (msgspec.MsgspecError, TypeError, ValueError, OverflowError, RecursionError)


def request_of(data: bytes, height: float | None) -> GotoRequest:
    """Return the request to fly to a published goal; raise Invalid. See goal_of for `height`."""
    try:
        plain = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Invalid(f"the goal is not JSON: {error}", _GOAL_HINT) from error
    place, grounded = plain, False
    for name in ("pose", "position", "point"):
        if isinstance(place, dict) and name in place:
            place, grounded = place[name], True
    if not isinstance(place, dict):
        raise Invalid("the goal is not a point", _GOAL_HINT)
    header = plain.get("header")
    frame = header.get("frame_id", "") if isinstance(header, dict) else ""
    axes = place.get("x"), place.get("y"), place.get("z")
    return goal_of(str(frame), axes, height, grounded=grounded)


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
