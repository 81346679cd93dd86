"""Which vehicles are on a hub: those that fly, and nobody who only listens or looks on."""

from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from quadctl.schemas.keyexpr import EndpointInfo, endpoint_key, node_key
from quadctl.schemas.topics import GOTO, POSE
from quadctl.services.runtime.bus import liveliness as roster


class Bus:
    """A session of which only the announcements are asked."""

    def __init__(self, *keys: str) -> None:
        self._keys = [zenoh.KeyExpr(key) for key in keys]

    def liveliness(self) -> "Bus":
        return self

    def get(self, pattern: str, timeout: float) -> list[Any]:
        asked = zenoh.KeyExpr(pattern)
        found = [key for key in self._keys if asked.intersects(key)]
        return [SimpleNamespace(ok=SimpleNamespace(key_expr=key)) for key in found]


def there(*keys: str) -> list[str]:
    return roster.vehicles(Bus(*keys))  # type: ignore[arg-type]


def offered(vehicle: str, node: str, kind: Any, key: str) -> str:
    return endpoint_key(vehicle, EndpointInfo(kind, node, "T", "1a2b3c4d", 1.0, key))


@pytest.mark.parametrize("node", ["dynamics", "pressure", "safety"])
def test_one_node_of_its_own_is_enough(node: str):
    assert there(node_key("uav1", node), node_key("uav0", node)) == ["uav0", "uav1"]


@pytest.mark.parametrize("node", ["hub", "gate", "recorder", "record-17", "camera"])
def test_who_outlives_a_vehicle_is_none(node: str):
    """A recorder goes on over the end of the run that it was begun in."""
    image = offered("uav", node, "@pub", "uav/camera/image")
    assert there(node_key("uav", node), image, node_key("uav0", "safety")) == ["uav0"]


def test_who_stands_in_for_a_vehicle_is_one():
    pose = offered("a", "mocap", "@pub", POSE.key("a"))
    goto = offered("b", "autopilot", "@srv", GOTO.key("b"))
    others = offered("c", "mirror", "@pub", POSE.key("a"))
    keys = [pose, goto, others, *(node_key(*names) for names in
            [("a", "mocap"), ("b", "autopilot"), ("c", "mirror")])]  # fmt: skip
    assert there(*keys) == ["a", "b"]


def test_nobody_is_there():
    assert there() == []
