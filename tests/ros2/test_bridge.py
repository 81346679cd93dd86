"""The vehicle in ROS 2, seen and flown by an independent client."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from math import dist
from typing import Any

import pytest
import zenoh.ext
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__Parameter as Parameter

import quadctl
from quadctl.services.bridges.ros2 import graph, messages, parameters
from quadctl.services.bridges.ros2.messages import SET_BOOL, TRIGGER, RosService
from quadctl.services.runtime.bus.session import free_port
from tests.support.lab import Lab
from tests.support.ros import POSE, RosClient, bridge, bridged, call, raw_client, readers, router
from tests.support.running import DEADLINE


@pytest.fixture(scope="module")
def network() -> Iterator[str]:
    with router() as endpoint:
        yield endpoint


@pytest.fixture(scope="module")
def run() -> Iterator[quadctl.Run]:
    with quadctl.launch() as run:
        yield run


@pytest.fixture(scope="module")
def ros(
    network: str, run: quadctl.Run, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RosClient]:
    with bridge(run.realm, network):
        client = RosClient(network, tmp_path_factory.mktemp("definitions"))
        client.wait("pose")
        yield client
        client.close()


def at(message: Any) -> tuple[float, float, float]:
    place = message.pose.position
    return place.x, place.y, place.z


@pytest.mark.thorough
def test_a_goal_on_the_ground_keeps_the_height_as_rviz_points_there(
    ros: RosClient, run: quadctl.Run
):
    run.vehicle.goto(0, 0, 1.2)
    ros.wait("safety_state", lambda state: state.data == "HOVERING")
    ros.goal(1.0, 0.0, 0.0)
    ros.wait("pose", lambda pose: dist(at(pose), (1, 0, 1.2)) < 0.05)


def test_a_goal_of_another_frame_is_ignored(ros: RosClient, run: quadctl.Run):
    before = run.vehicle.state().request
    ros.goal(1.0, 1.0, 1.0, frame="odom")
    ros.goal(float("nan"), 1.0, 1.0)
    # Goals and calls are taken in their order.
    assert ros.call("toggle_cage", SET_BOOL.name, "bool data", data=True).success
    assert run.vehicle.state().request == before


@pytest.mark.thorough
def test_messages_have_units_and_frames_of_ros(ros: RosClient):
    odometry = ros.wait("odom")
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "uav/base_link")
    assert abs(odometry.header.stamp.sec - time.time()) < 5
    assert 100_000 < ros.wait("pressure").fluid_pressure < 102_000
    (cage,) = (each for each in ros.wait("cage").markers if each.ns == "uav/cage")
    assert len(cage.points) == 24
    assert {abs(point.x) for point in cage.points} == {5.0}


@pytest.mark.thorough
def test_the_clients_command_lists_what_the_bridge_offers(ros: RosClient, network: str):
    def listed(noun: str) -> str:
        address = network.removeprefix("tcp/")
        command = ["-m", "zenoh_ros2_sdk.cli", "--no-daemon", "--router", address, noun, "list"]
        found = subprocess.run(
            [sys.executable, *command, "-t"], check=True, capture_output=True, text=True, timeout=60
        )
        return found.stdout

    topics = listed("topic")
    for name in ("pose", "odom", "pressure", "cage", "safety_state", "goal_pose"):
        assert f"/uav/{name}" in topics
    assert "/tf" in topics
    services = listed("service")
    for name in ("toggle_cage", "calibrate_pressure", "hold", "reset"):
        assert f"/uav/{name}" in services


def test_a_late_joiner_gets_the_latched_state(ros: RosClient, network: str):
    type_ = "std_msgs/msg/String"
    key = graph.endpoint_key(
        0, "/uav/safety_state", graph.type_key(type_, messages.type_hash(type_))
    )
    ros.wait("safety_state")  # the next one comes a second later
    with raw_client(network) as session:
        found = session.get(
            f"{key}/@adv/**", accept_replies=zenoh.ReplyKeyExpr.ANY, timeout=DEADLINE
        )
        payloads = [each.ok.payload.to_bytes() for each in found if each.ok]
    states = [messages.decode(type_, each).data for each in payloads]
    assert states
    assert states[0].startswith(("HOVERING", "MOVING", "VERIFYING"))


@pytest.mark.thorough
def test_the_router_may_go_and_come_back(lab: Lab):
    lab.start()
    port = free_port()
    with ExitStack() as bridge:
        with router(port) as endpoint:
            bridge.enter_context(bridged(lab, endpoint, "8"))
            with raw_client(endpoint) as session, readers(session, "8"):
                pass
        with router(port), raw_client(endpoint) as session, readers(session, "8"):
            assert call(session, "8/uav/hold", TRIGGER, 0).success


@pytest.mark.thorough
def test_several_vehicles_have_namespaces_and_one_clock_where_time_is_simulated(network: str):
    with (
        quadctl.launch(vehicles=2, params={"dynamics.speed": 2.0}) as run,
        bridge(run.realm, network, "--domain", "6"),
        raw_client(network) as session,
    ):
        clock, first, second = (
            session.declare_subscriber(f"6/{name}/**")
            for name in ("clock", "uav0/pose", "uav1/pose")
        )
        ticks: list[tuple[int, int]] = []
        # The time of a pose comes again if safety is late with its answer: the clock waits for it.
        while len(ticks) < 3:
            now = messages.decode("rosgraph_msgs/msg/Clock", clock.recv().payload.to_bytes()).clock
            if (tick := (now.sec, now.nanosec)) not in ticks:
                ticks.append(tick)
        assert ticks == sorted(ticks)
        assert ticks[-1] < (1000, 0)
        for poses in (first, second):
            stamp = messages.decode(POSE, poses.recv().payload.to_bytes()).header.stamp
            assert stamp.sec < 1000
        found = session.liveliness().get("@ros2_lv/6/**")
        tokens = [str(each.ok.key_expr) for each in found if each.ok]
        nodes = [token.split("/")[-2:] for token in tokens if "/NN/" in token]
        assert sorted(nodes) == [["%uav0", "quadctl"], ["%uav1", "quadctl"]]
        assert len([token for token in tokens if "%clock" in token]) == 1


def test_parameters_are_read_and_set_as_those_of_a_node_of_ros(
    ros: RosClient, run: quadctl.Run, network: str
):
    def ask(service: RosService, *fields: Any) -> Any:
        name = "".join(f"_{c.lower()}" if c.isupper() else c for c in service.name.split("/")[2])
        return call(session, f"0/uav/quadctl/{name[1:]}", service, *fields)

    name = "safety.acceptance_range"
    with raw_client(network) as session:
        names = ask(messages.LIST_PARAMETERS, ["safety"], 0).result.names
        assert name in names
        given = [Parameter(name, parameters.to_ros(each)) for each in (0.375, -1.0)]
        done, refused = ask(messages.SET_PARAMETERS, given).results
        assert done.successful
        assert "expected" in refused.reason
        assert run.vehicle.params[name] == 0.375
        (value,) = ask(messages.GET_PARAMETERS, [name]).values
        assert (value.type, value.double_value) == (3, 0.375)
        (about,) = ask(messages.DESCRIBE_PARAMETERS, [name]).descriptors
        assert about.description
