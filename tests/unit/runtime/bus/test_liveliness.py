"""Vehicles on a hub: those that fly, not nodes that only subscribe."""

from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from quadctl.schemas.keyexpr import EndpointInfo, endpoint_key, node_key
from quadctl.schemas.topics import GOTO, POSE
from quadctl.services.runtime.bus import liveliness as roster


class Bus:
    """Session with liveliness tokens and nothing else."""

    def __init__(self, *keys: str) -> None:
        self._keys = [zenoh.KeyExpr(key) for key in keys]

    def liveliness(self) -> "Bus":
        return self

    def get(self, pattern: str, timeout: float) -> list[Any]:
        wanted = zenoh.KeyExpr(pattern)
        found = [key for key in self._keys if wanted.intersects(key)]
        return [SimpleNamespace(ok=SimpleNamespace(key_expr=key)) for key in found]


def vehicles_of(*keys: str) -> list[str]:
    return roster.vehicles(Bus(*keys))  # type: ignore[arg-type]


def offered(vehicle: str, node: str, kind: Any, key: str) -> str:
    return endpoint_key(EndpointInfo(vehicle, kind, node, "T", "1a2b3c4d", 1.0, key))


@pytest.mark.parametrize("node", ["dynamics", "pressure", "safety"])
def test_one_node_makes_a_vehicle_present(node: str):
    assert vehicles_of(node_key("uav1", node), node_key("uav0", node)) == ["uav0", "uav1"]


@pytest.mark.parametrize("node", ["hub", "gate", "recorder", "record-17", "camera"])
def test_nodes_that_outlive_a_vehicle_do_not_count(node: str):
    """A recorder outlives the run it was started in."""
    image = offered("uav", node, "@pub", "uav/camera/image")
    assert vehicles_of(node_key("uav", node), image, node_key("uav0", "safety")) == ["uav0"]


def test_a_node_with_a_vehicles_endpoints_counts():
    pose = offered("a", "mocap", "@pub", POSE.key("a"))
    goto = offered("b", "autopilot", "@srv", GOTO.key("b"))
    others = offered("c", "mirror", "@pub", POSE.key("a"))
    keys = [pose, goto, others, *(node_key(*names) for names in
            [("a", "mocap"), ("b", "autopilot"), ("c", "mirror")])]  # fmt: skip
    assert vehicles_of(*keys) == ["a", "b"]


def test_without_tokens_there_is_no_vehicle():
    assert vehicles_of() == []


def test_what_is_present_are_nodes_and_servers_of_the_vehicles_asked_for():
    goto = offered("a", "safety", "@srv", GOTO.key("a"))
    pose = offered("a", "dynamics", "@pub", POSE.key("a"))
    bus: Any = Bus(goto, pose, node_key("a", "safety"), node_key("b", "safety"))
    assert roster.present(bus, ["a"]) == ({("a", "safety")}, {GOTO.key("a"): "safety"})
    everything = roster.present(bus, ["*"])
    assert everything.nodes == {("a", "safety"), ("b", "safety")}
    assert roster.present(bus, ["b"]) == ({("b", "safety")}, {})
