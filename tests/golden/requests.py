"""Requests as today's commands send them, with an attachment that never expires."""

from collections.abc import Iterator
from math import nan
from typing import Any

from msgspec import convert, msgpack

from tests.golden import product

NEVER = 4102444800.0
"""Unix time, s: the year 2100."""
PLAIN = "application/msgpack"


def requests() -> Iterator[dict[str, Any]]:
    """Yield each request to record, in the order of sending."""
    for number, (name, service, fields) in enumerate(_asked(), 1):
        type_ = product.request_type(service)
        yield _request(
            name,
            service,
            product.encode(convert(fields, type_)),
            product.encoding(type_),
            _attachment(f"recorded {number}", NEVER),
        )
    point = {"x": 0.25, "y": 0.0, "z": 1.0}
    known = product.encoding(product.request_type("goto"))
    yield _request("without an id", "hold", msgpack.encode({}), PLAIN)
    yield _request("without a digest", "goto", msgpack.encode(point), PLAIN)
    yield _request("NaN", "goto", msgpack.encode(point | {"x": nan}), PLAIN)
    yield _request("an unknown field", "goto", msgpack.encode(point | {"w": 1.0}), PLAIN)
    yield _request("no map", "goto", b"\xc1", PLAIN)
    yield _request("another schema", "goto", msgpack.encode(point), f"{known[:-8]}00000000")
    late = _attachment("late", 1.0)
    yield _request("expired", "hold", msgpack.encode({}), PLAIN, late)
    yield _request("an attachment that is none", "hold", msgpack.encode({}), PLAIN, b"\xc1")


def _asked() -> Iterator[tuple[str, str, dict[str, Any]]]:
    cage = "safety.virtual_cage"
    yield "calibrate", "calibrate_pressure", {"zero": True}
    yield "calibrate --unset", "calibrate_pressure", {"zero": False}
    yield "cage off", "toggle_cage", {"cage_on": False}
    yield "cage on", "toggle_cage", {"cage_on": True}
    yield "goto", "goto", {"x": 0.5, "y": 0.0, "z": 1.0, "replace": False}
    yield "goto --replace", "goto", {"x": 0.25, "y": 0.0, "z": 1.0, "replace": True}
    yield "goto outside", "goto", {"x": 9.0, "y": 0.0, "z": 1.0, "replace": True}
    yield "hold", "hold", {}
    yield "param get", "safety/get_params", {"names": [f"{cage}.x", f"{cage}.z"]}
    yield "param get of dynamics", "dynamics/get_params", {"names": ["dynamics.control"]}
    yield "param get of an unknown one", "safety/get_params", {"names": ["safety.nonsense"]}
    yield "param set", "safety/set_params", {"values": {"safety.acceptance_range": 0.4}}
    yield "param set out of bounds", "safety/set_params", {"values": {"safety.margin": -1.0}}
    yield "reset", "reset", {}


def _request(
    name: str, service: str, payload: bytes, encoding: str, attachment: bytes = b""
) -> dict[str, Any]:
    return {
        "name": name,
        "key": f"uav/@srv/{service}",
        "encoding": encoding,
        "payload": payload.hex(),
        "attachment": attachment.hex(),
    }


def _attachment(call_id: str, deadline: float) -> bytes:
    return product.encode(product.Call(id=call_id, deadline=deadline))
