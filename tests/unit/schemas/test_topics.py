"""Keys of all topics and services, as in the contract."""

import msgspec
import pytest

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import (
    MESSAGES,
    SERVICES,
    SETPOINT,
    TOPICS,
    Topic,
    get_params,
    set_params,
)
from quadctl.services.runtime.process_table import NODES

TOPIC_TABLE = {
    "uav/pose": ("Pose", "dynamics", 100, False),
    "uav/pose/slow": ("Pose", "dynamics", 20, False),
    "uav/sensors/pressure": ("Pressure", "pressure", 10, False),
    "uav/safety/state": ("SafetyState", "safety", 1, True),
    "uav/safety/zones": ("Zones", "safety", 0, True),
    "uav/input/position_request": ("Waypoint", "", 0, False),
    "uav/input/position": ("Setpoint", "safety", 20, False),
    "uav/info": ("Info", "safety", 0, True),
}
SERVICE_TABLE = {
    "uav/@srv/calibrate_pressure": ("Calibrate", "pressure", ["zero"], ["baseline"]),
    "uav/@srv/toggle_cage": ("ToggleCage", "safety", ["cage_on"], ["success"]),
    "uav/@srv/goto": (
        "Goto",
        "safety",
        ["x", "y", "z", "replace", "direct", "wait"],
        ["accepted", "reason"],
    ),
    "uav/@srv/hold": ("Hold", "safety", [], ["success"]),
    "uav/@srv/reset": ("Reset", "dynamics", [], ["success"]),
}


def test_every_topic_of_the_contract_is_declared():
    declared = {
        topic.key("uav"): (topic.type.__name__, topic.node, topic.hz, topic.latched)
        for topic in TOPICS
    }
    assert TOPIC_TABLE.items() <= declared.items()


def test_every_service_of_the_contract_is_declared():
    declared = {
        service.key("uav"): (
            service.type_name,
            service.node,
            list(service.request.__struct_fields__),
            list(service.response.__struct_fields__),
        )
        for service in SERVICES
    }
    assert SERVICE_TABLE.items() <= declared.items()


@pytest.mark.parametrize("node", NODES)
def test_every_node_has_the_two_services_of_its_parameters(node: str):
    get, put = get_params(node), set_params(node)
    assert (get.key("uav"), get.type_name) == (f"uav/@srv/{node}/get_params", "GetParams")
    assert (put.key("uav"), put.type_name) == (f"uav/@srv/{node}/set_params", "SetParams")
    assert get.node == put.node == node
    assert get.request.__struct_fields__ == ("names",)
    assert get.response.__struct_fields__ == ("values", "in_force")
    assert put.request.__struct_fields__ == ("values",)
    assert put.response.__struct_fields__ == ("success", "reason", "waits")


def test_goto_does_not_replace_unless_asked():
    (replace,) = [f for f in msgspec.structs.fields(SERVICES[2].request) if f.name == "replace"]
    assert replace.default is False


def test_names_are_unique_and_the_vehicle_is_the_first_chunk():
    keys = [entry.key("drone-7") for entry in (*TOPICS, *SERVICES)]
    assert len(set(keys)) == len(keys)
    assert all(key.split("/")[0] == "drone-7" for key in keys)
    # A percent sign represents the slash in liveliness tokens; a wildcard is no name.
    assert not any(set(key) & set("%*$#?") for key in keys)
    assert {topic.type for topic in TOPICS} == set(MESSAGES.values())


def test_every_topic_and_service_has_a_docstring_and_a_node():
    assert all(entry.doc.endswith(".") for entry in (*TOPICS, *SERVICES))
    assert {entry.node for entry in (*TOPICS, *SERVICES)} <= {*NODES, ""}


@pytest.mark.parametrize("hz", [7.0, 10.0, 20.0, 100.0])
def test_each_counted_stamp_is_in_its_own_period(hz: float):
    """Also if rounding puts the stamp, a quotient, just below its boundary."""
    topic = Topic("t", Pose, node="n", hz=hz, doc="d")
    assert [topic.period(count / hz) for count in range(10_000)] == list(range(10_000))
    assert topic.period(1e6 - 0.5 / hz) == round(1e6 * hz) - 1


def test_at_100_poses_a_second_every_fifth_starts_a_period():
    periods = [SETPOINT.period(count / 100) for count in range(1000)]
    assert periods == [count // 5 for count in range(1000)]
