"""Rights of each role, written out here independently of the product's table."""

from typing import get_args

import pytest

from quadctl.schemas.roles import ROLES, Right, Role, may, node_may
from quadctl.schemas.topics import SERVICES, TOPICS, get_params, set_params

NODES = ("dynamics", "pressure", "safety")
PARAMS = [of(node).name for node in NODES for of in (get_params, set_params)]
CALLS = {
    "observer": set(),
    "vehicle": set(),
    "safety": set(),
    "student": {"goto", "hold", "calibrate_pressure", "reset",
                "dynamics/get_params", "pressure/get_params", "safety/get_params"},
}  # fmt: skip
PUBLISHES = {
    "observer": set(),
    "student": {"input/position_request"},
    "operator": {"input/position_request"},
    "vehicle": {"pose", "pose/slow", "sensors/pressure"},
    "safety": {"safety/state", "safety/zones", "input/position", "info"},
}
SERVES = {
    "vehicle": {"calibrate_pressure", "reset", "dynamics/get_params", "dynamics/set_params",
                "pressure/get_params", "pressure/set_params"},
    "safety": {"goto", "hold", "toggle_cage", "safety/get_params", "safety/set_params"},
}  # fmt: skip
ROLES_BUT_HUB = [role for role in ROLES if role != "hub"]


def allowed(role: Role, right: Right, names: list[str], prefix: str = "") -> set[str]:
    return {name for name in names if may(role, ["uav7"], right, f"uav7/{prefix}{name}")}


@pytest.mark.parametrize("role", ROLES_BUT_HUB)
def test_each_role_may_call_its_services(role: Role):
    services = [*(service.name for service in SERVICES), *PARAMS]
    assert allowed(role, "call", services, "@srv/") == CALLS.get(role, set(services))


@pytest.mark.parametrize("role", ROLES_BUT_HUB)
def test_each_role_may_publish_and_serve_its_own(role: Role):
    topics = [topic.name for topic in TOPICS]
    assert allowed(role, "publish", topics) == PUBLISHES[role]
    services = [*(service.name for service in SERVICES), *PARAMS]
    assert allowed(role, "serve", services, "@srv/") == SERVES.get(role, set())
    assert allowed(role, "listen", topics) == set(topics)


def test_only_safety_may_publish_setpoints_even_by_a_pattern():
    keys = ["uav7/input/position", "uav7/input/*", "uav7/**", "uav7/input/$*", "*/input/position"]
    for key in keys:
        writers = {role for role in ROLES if may(role, ["uav7"], "publish", key)}
        assert writers <= {"hub", "safety"}
        assert "safety" not in writers or key == keys[0]


@pytest.mark.parametrize("role", ROLES)
def test_no_role_has_rights_to_another_vehicle_but_to_see_it(role: Role):
    others = {
        (right, topic)
        for right in get_args(Right)
        for topic in (*(t.name for t in TOPICS), "@srv/goto", "@srv/toggle_cage", "@node/safety",
                      "@node/gate", "own/x", "@call/goto")
        if may(role, ["uav7"], right, f"uav8/{topic}")
    }  # fmt: skip
    assert others == {("read", "info"), ("see", "@node/gate")}


@pytest.mark.parametrize("role", ["operator", "student"])
def test_a_pattern_of_services_is_not_a_service(role: Role):
    assert not may("student", ["uav7"], "call", "uav7/@srv/*")
    assert not may(role, ["uav7"], "call", "*/@srv/goto")
    assert not may(role, ["uav7"], "call", "uav7/**/@srv/goto")


def test_a_role_can_be_for_all_vehicles():
    for key in ("uav1/pose", "x/pose", "**", "*/pose"):
        assert may("observer", ["*"], "listen", key)
    assert not may("observer", ["*"], "call", "uav1/@srv/goto")


@pytest.mark.parametrize("role", ["vehicle", "safety", "operator", "student"])
def test_users_have_their_own_place_for_nodes_and_topics(role: Role):
    own: dict[Right, str] = {
        "publish": "own/camera/image", "serve": "@srv/own/snap", "announce": "@node/own-camera",
    }  # fmt: skip
    for right, name in own.items():
        assert may(role, ["uav7"], right, f"uav7/{name}")
    offers = {
        "@pub/Image/1a2b/10/uav7%own%camera": True,
        "@srv/Snap/1a2b/0/uav7%@srv%own%snap": True,
        "@srv/Goto/1a2b/0/uav7%@srv%goto": False,
    }
    for offer, fits in offers.items():
        assert may(role, ["uav7"], "announce", f"uav7/@node/own-camera/{offer}") is fits


@pytest.mark.parametrize("node", ["safety", "pressure"])
def test_a_guarded_node_has_the_rights_of_its_name_alone(node: str):
    topics = {topic.name: topic.node for topic in TOPICS}
    services = {service.name: service.node for service in SERVICES}
    services |= {of(name).name: name for name in NODES for of in (get_params, set_params)}
    for name, owner in topics.items():
        assert node_may(node, "publish", f"uav7/{name}") is (owner == node), name
        assert node_may(node, "listen", f"uav7/{name}"), name
    for name, owner in services.items():
        reads = name.endswith("/get_params")
        assert node_may(node, "serve", f"uav7/@srv/{name}") is (owner == node), name
        assert node_may(node, "call", f"uav7/@srv/{name}") is reads, name
    for name in NODES:
        assert node_may(node, "announce", f"uav7/@node/{name}") is (name == node)
    for key in ("uav7/own/x", "uav7/@call/dynamics/set_params", "uav7/@call/reset", "uav7/*"):
        assert node_may(node, "publish", key) is (key == "uav7/own/x")
